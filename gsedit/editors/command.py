"""Any program as a 2D editor: it is given a folder of PNGs and must fill another.

No shell is involved. The command is split once, as a shell would split it, and only then are
`{input}`, `{output}`, `{prompt}` and `{seed}` put in: whatever the instruction holds, it stays
inside one argument. (One that begins with a dash may still look like an option to the program:
`--prompt={prompt}` tells it otherwise.) `v` views of `h w` pixels.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.harmonise import harmonise
from gsedit.diffusion import SamplerSettings
from gsedit.editors.protocol import Capabilities, EditBatch, EditProgress
from gsedit.errors import GseditError, InputError, UsageError

FIELDS = ("input", "output", "prompt", "seed")
EXAMPLE = '--run "my_editor {input} {output} {prompt}"'
CELL = 2
"""Pixels of a cell in which views agree: a program has no latent cells. Of 1, 2, 4 and 8, measured
on rendered depth, 2 matches most and comes nearest to the known answer."""
POLL = 0.1  # seconds between looks at a program: it works for seconds at least
GRACE = 3.0  # seconds between asking a program to stop and ending it
QUOTED = 5  # last lines of what a failed program said


@dataclass(frozen=True, eq=False)
class Command:
    """An Editor that runs a program for every batch of views."""

    run: str
    """The command, as for a shell, with {input} and {output} in it, and {prompt}, {seed} at will.
    The folders are absolute; the program starts where gsedit was started."""
    timeout: float | None = None
    """Seconds for a batch of views; None: as long as it takes."""
    folder: Path | None = None
    """Where folders are exchanged; None: the system's place for temporary files. What a program
    that failed was given, made and said stays there."""
    name: str = "command"
    cell: int = CELL
    capabilities: Capabilities = field(default_factory=Capabilities)

    def __post_init__(self) -> None:
        if self.timeout is not None and not self.timeout > 0:
            raise UsageError(f"--timeout must be more than 0 seconds, not {self.timeout:g}")
        fields = re.findall(r"\{([a-z_]+)\}", self.run)
        for unknown in sorted(set(fields) - set(FIELDS)):
            known = ", ".join(f"{{{name}}}" for name in FIELDS)
            raise UsageError(f"--run knows no {{{unknown}}}, only {known}")
        for needed in ("input", "output"):
            if needed not in fields:
                raise UsageError(
                    f"--run has no {{{needed}}}: say where the program finds the folder, "
                    f"as in {EXAMPLE}"
                )
        self.words()

    def words(self) -> list[str]:
        """The command as a list of arguments, before anything is put in. Raises UsageError."""
        try:
            return shlex.split(self.run)
        except ValueError as error:
            raise UsageError(f"--run cannot be split into words ({error}): {self.run}") from None

    def check(self, prompt: str) -> None:
        """Raise UsageError without such a program, or for an instruction it cannot be given."""
        if "{prompt}" in self.run and not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if "\0" in prompt:
            raise UsageError("the instruction has a NUL character in it, which no program is given")
        program = self.words()[0]
        if shutil.which(program) is None:
            raise UsageError(
                f"there is no program {program!r} to run: install it, or give its whole path in "
                "--run (a script must be executable, or be given to its interpreter: "
                "'python script.py ...')"
            )

    def arguments(self, given: dict[str, str]) -> list[str]:
        """The command's arguments with every field put in; each stays one argument."""
        pattern = re.compile("|".join(rf"\{{{name}\}}" for name in FIELDS))
        return [pattern.sub(lambda field: given[field[0][1:-1]], word) for word in self.words()]

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Run the program on the views that are not anchored; a step is a picture it has written.

        What it makes is brought to agreement where views correspond (`harmonise`). The program is
        ended when the caller leaves early. Raises UsageError where it cannot be started,
        GseditError where it fails or takes too long, InputError for what it left out or made of
        another size; each says where its folders remain.
        """
        self.check(batch.prompt)
        free = _free(batch)
        names = [f"{view:03d}.png" for view in free]
        edited = batch.images.clone()
        if names:
            folder = self._new_folder()
            _write(batch.originals[free], folder / "input", names)
            for made in self._watch(batch, folder, names):
                yield EditProgress(made, len(names) + 1)
            edited[free] = _read(folder, names, batch.images).to(edited)
            self._remove(folder)
        if batch.correspondences is not None and settings.consensus:
            edited = harmonise(
                edited,
                batch.correspondences,
                anchored=batch.anchored,
                strength=settings.consensus_strength,
            )
        yield EditProgress(len(names) + 1, len(names) + 1, edited)

    def _new_folder(self) -> Path:
        """A folder of this batch's own, with an empty `output` in it."""
        try:
            if self.folder is not None:
                self.folder.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(prefix="batch-", dir=self.folder)).absolute()
            for name in ("input", "output"):
                (folder / name).mkdir()
        except OSError as error:
            raise UsageError(
                f"no folder can be made to exchange pictures in ({error}): is the disk full?"
            ) from error
        return folder

    def _remove(self, folder: Path) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        if self.folder is not None:
            with suppress(OSError):  # what an earlier run left is not ours to remove
                self.folder.rmdir()

    def _watch(self, batch: EditBatch, folder: Path, names: Sequence[str]) -> Iterator[int]:
        """Run the program to its end; yields the number of pictures whenever it has grown."""
        output, complaints = folder / "output", folder / "stderr.txt"
        given = {
            "input": str(folder / "input"),
            "output": str(output),
            "prompt": batch.prompt,
            "seed": str(batch.seed),
        }
        until = None if self.timeout is None else time.monotonic() + self.timeout
        with (folder / "stdout.txt").open("wb") as said, complaints.open("wb") as complained:
            program = _start(self.arguments(given), said, complained)
            try:
                seen = 0
                while (code := _wait(program)) is None:
                    if until is not None and time.monotonic() > until:
                        raise GseditError(
                            f"{self._program} was stopped after {self.timeout:g} s: raise "
                            f"--timeout or lower --views. {_remains(folder, names)}"
                        )
                    made = _count(output, names)
                    if made > seen:
                        seen = made
                        yield made
            finally:
                _end(program)
        if code:
            how = f"ended with code {code}" if code > 0 else f"was ended by {_signal(-code)}"
            raise GseditError(
                f"{self._program} {how}; {_last_words(folder)}. {_remains(folder, names)}"
            )

    @property
    def _program(self) -> str:
        return Path(self.words()[0]).name


def _free(batch: EditBatch) -> list[int]:
    """The views that are to be edited."""
    if batch.anchored is None:
        return list(range(len(batch.images)))
    return torch.nonzero(~batch.anchored).squeeze(1).tolist()


def _start(arguments: list[str], said: IO[bytes], complained: IO[bytes]) -> subprocess.Popen[bytes]:
    """The program in a group of its own, so that what it starts can be ended with it."""
    try:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,  # a question would wait for ever
            stdout=said,  # not ours: results for other programs go there
            stderr=complained,
            start_new_session=True,
        )
    except OSError as error:
        raise UsageError(
            f"{arguments[0]} cannot be started ({error.strerror}): is it executable?"
        ) from error


def _wait(program: subprocess.Popen[bytes]) -> int | None:
    """The exit code, or None after POLL seconds."""
    try:
        return program.wait(POLL)
    except subprocess.TimeoutExpired:
        return None


def _end(program: subprocess.Popen[bytes]) -> None:
    """End the program and all it started, unless it ended well: first asked to, then made to."""
    if program.poll() == 0:
        return
    try:
        _send(program, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            program.wait(GRACE)
    finally:
        _send(program, getattr(signal, "SIGKILL", signal.SIGTERM))
        program.wait()


def _send(program: subprocess.Popen[bytes], what: int) -> None:
    if not hasattr(os, "killpg"):  # Windows
        program.send_signal(what)
        return
    with suppress(ProcessLookupError):  # everything has ended meanwhile
        os.killpg(program.pid, what)


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _write(images: Float[Tensor, "v h w 3"], folder: Path, names: Sequence[str]) -> None:
    from PIL import Image

    for image, name in zip(images, names, strict=True):
        levels = (image.clamp(0, 1) * 255).round().to(torch.uint8)
        Image.fromarray(levels.cpu().numpy()).save(folder / name)


def _read(folder: Path, names: Sequence[str], like: Float[Tensor, "v h w 3"]) -> Tensor:
    """The pictures that the program made. Raises InputError naming the first bad one."""
    from gsedit.files.pictures import read_picture

    height, width = like.shape[1:3]
    pictures = []
    for name in names:
        path = folder / "output" / name
        if not path.is_file():
            others = sorted(p.name for p in (folder / "output").iterdir() if p.name not in names)
            found = f" (it wrote {', '.join(others[:3])})" if others else ""
            raise InputError(
                f"the program ended well but made no {name}{found}: {{output}} needs a picture of "
                f"the same name for every one in {{input}}. {_remains(folder, names)}"
            )
        try:
            picture = read_picture(path)
        except InputError as error:
            raise InputError(f"{error}. {_remains(folder, names)}") from None
        if tuple(picture.shape[:2]) != (height, width):
            raise InputError(
                f"the program made {name} {picture.shape[1]}x{picture.shape[0]} pixels of one of "
                f"{width}x{height}: the sizes must be equal, or the picture does not fit its "
                f"camera. {_remains(folder, names)}"
            )
        pictures.append(picture)
    return torch.stack(pictures)


def _count(folder: Path, names: Sequence[str]) -> int:
    return sum((folder / name).is_file() for name in names)


def _last_words(folder: Path) -> str:
    """The end of what a program said on stderr, or else on stdout, for quoting on one line."""
    for name in ("stderr.txt", "stdout.txt"):
        with (folder / name).open(encoding="utf-8", errors="replace") as file:
            lines = deque((line.strip() for line in file if line.strip()), QUOTED)
        if lines:
            return f"it said: {' | '.join(lines)}"
    return "it said nothing"


def _remains(folder: Path, names: Sequence[str]) -> str:
    made = _count(folder / "output", names)
    return f"{made} of {len(names)} pictures are in {folder / 'output'}"
