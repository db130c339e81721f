"""The editor and the mask provider `command`: a program is run for every batch of pictures.

It fills a folder of pictures from another. No shell is involved. The command is split once, as a
shell would split it, and only then are the FIELDS put in: whatever the instruction holds, it stays
inside one argument. (One that begins with a dash may still look like an option to the program:
`--prompt={prompt}` prevents that.) A program never outlives its caller.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.pictures import as_picture, read_picture
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.plugins import EXAMPLE, MASK_EXAMPLE
from gsedit.paper.editors.protocol import Capabilities, EditBatch, EditProgress
from gsedit.select.masked import read_mask

FIELDS = ("input", "output", "prompt", "seed", "renders", "masks", "python")
POLL = 0.1  # seconds between looks at a program, which works for seconds at least


def split_command(run: str, known: Sequence[str] = FIELDS, example: str = EXAMPLE) -> list[str]:
    """The command as a list of words, fields in place. Raises UsageError if it is not valid, with
    the option that it was given as, which the example begins with."""
    option = example.split()[0]
    fields = re.findall(r"\{([a-z_]+)\}", run)
    for unknown in sorted(set(fields) - set(known)):
        names = ", ".join(f"{{{name}}}" for name in known)
        raise UsageError(f"{option} knows no {{{unknown}}}, only {names}")
    for needed in ("input", "output"):
        if needed not in fields:
            raise UsageError(
                f"{option} has no {{{needed}}}: say where the program finds the folder, "
                f"as in {example}"
            )
    try:
        return shlex.split(run)
    except ValueError as error:
        raise UsageError(f"{option} cannot be split into words ({error}): {run}") from None


def check_program(word: str, option: str = "--run") -> None:
    """Raise UsageError where there is no program of that name to run."""
    if word != "{python}" and shutil.which(word) is None:
        raise UsageError(
            f"there is no program {word!r} to run: install it, or give its whole path in "
            f"{option} (a script must be executable, or be given to its interpreter: "
            "'python script.py ...')"
        )


def fill_fields(words: list[str], values: Mapping[str, str]) -> list[str]:
    """The words with every field replaced by its value; each stays one argument."""
    pattern = re.compile("|".join(rf"\{{{name}\}}" for name in values))
    return [pattern.sub(lambda field: values[field[0][1:-1]], word) for word in words]


@contextmanager
def running(
    arguments: list[str], stdout: IO[bytes], stderr: IO[bytes]
) -> Iterator[subprocess.Popen[bytes]]:
    """The program, started; at the end of the block it and all it started are ended.

    Raises UsageError where it cannot be started.
    """
    program = _start(arguments, stdout, stderr)
    try:
        yield program
    finally:
        _end(program)


def wait(program: subprocess.Popen[bytes]) -> int | None:
    """The exit code, or None after POLL seconds."""
    try:
        return program.wait(POLL)
    except subprocess.TimeoutExpired:
        return None


def describe_exit(code: int) -> str:
    """How a program ended: with a code, or (negative) by a signal."""
    if code >= 0:
        return f"ended with code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was ended by {name}"


def _start(arguments: list[str], stdout: IO[bytes], stderr: IO[bytes]) -> subprocess.Popen[bytes]:
    """The program in a group of its own, so that what it starts can be ended with it."""
    try:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,  # a question would wait for ever
            stdout=stdout,  # not ours: results for other programs go there
            stderr=stderr,
            start_new_session=True,
        )
    except OSError as error:
        raise UsageError(
            f"{arguments[0]} cannot be started ({error.strerror}): is it executable?"
        ) from error


def _end(program: subprocess.Popen[bytes]) -> None:
    """End the program and all it started, unless it ended well: by SIGTERM, then by SIGKILL."""
    if program.poll() == 0:
        return
    try:
        _send(program, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            program.wait(3.0)  # before it is killed
    finally:
        _send(program, getattr(signal, "SIGKILL", signal.SIGTERM))
        program.wait()


def _send(program: subprocess.Popen[bytes], number: int) -> None:
    if not hasattr(os, "killpg"):  # Windows
        program.send_signal(number)
        return
    with suppress(ProcessLookupError):  # everything has ended meanwhile
        os.killpg(program.pid, number)


# ---- the folders ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Exchange:
    """A folder with `input`, `output`, and what the program writes on stdout and stderr."""

    folder: Path
    names: tuple[str, ...]
    """Names of the pictures, in both folders."""

    @property
    def input(self) -> Path:
        return self.folder / "input"

    @property
    def output(self) -> Path:
        return self.folder / "output"

    @property
    def stdout(self) -> Path:
        return self.folder / "stdout.txt"

    @property
    def stderr(self) -> Path:
        return self.folder / "stderr.txt"

    @property
    def finished(self) -> int:
        """The number of pictures that the program has written."""
        return sum((self.output / name).is_file() for name in self.names)

    @property
    def remains(self) -> str:
        """A sentence for error messages: what the program made, and where it is."""
        return f"{self.finished} of {len(self.names)} pictures are in {self.output}"

    def last_lines(self) -> str:
        """The end of what the program wrote on stderr, or else on stdout, on one line."""
        for path in (self.stderr, self.stdout):
            with path.open(encoding="utf-8", errors="replace") as file:
                lines = deque((line.strip() for line in file if line.strip()), 5)
            if lines:
                return f"it said: {' | '.join(lines)}"
        return "it said nothing"

    def write(self, inside: str, images: Iterable[Float[Tensor, "_ _ 3"]]) -> None:
        """The pictures as 8-bit PNGs into the folder `inside` this one."""
        place = self.folder / inside
        place.mkdir(exist_ok=True)
        for image, name in zip(images, self.names, strict=True):
            as_picture(image).save(place / name)

    def read(self, height: int, width: int) -> Float[Tensor, "v {height} {width} 3"]:
        """The pictures in `output`. Raises InputError naming the first bad one."""
        return torch.stack([self._read(name, height, width) for name in self.names])

    def made(self, name: str) -> Path:
        """The picture that the program made. Raises InputError where it made none."""
        path = self.output / name
        if not path.is_file():
            others = sorted(p.name for p in self.output.iterdir() if p.name not in self.names)
            wrote = f" (it wrote {', '.join(others[:3])})" if others else ""
            raise InputError(
                f"the program ended well but made no {name}{wrote}: {{output}} needs a picture of "
                f"the same name for every one in {{input}}. {self.remains}"
            )
        return path

    def _read(self, name: str, height: int, width: int) -> Float[Tensor, "{height} {width} 3"]:
        path = self.made(name)
        try:
            picture = read_picture(path)
        except InputError as error:
            raise InputError(f"{error}. {self.remains}") from None
        if tuple(picture.shape[:2]) != (height, width):
            raise InputError(
                f"the program made {name} {picture.shape[1]}x{picture.shape[0]} pixels of one of "
                f"{width}x{height}: the sizes must be equal, or the picture does not fit its "
                f"camera. {self.remains}"
            )
        return picture


def run_in(
    exchange: Exchange, arguments: list[str], timeout: float | None = None, advice: str = ""
) -> Iterator[int]:
    """Run a program to its end; yields the number of pictures whenever it has grown.

    It is ended after `timeout` seconds, and when the caller leaves early. Raises UsageError where
    it cannot be started, GseditError where it fails or takes too long (with `advice`).
    """
    name = Path(arguments[0]).name
    deadline = None if timeout is None else time.monotonic() + timeout
    finished = 0
    with (
        exchange.stdout.open("wb") as stdout,
        exchange.stderr.open("wb") as stderr,
        running(arguments, stdout, stderr) as program,
    ):
        while (code := wait(program)) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise GseditError(
                    f"{name} was stopped after {timeout:g} s: {advice}. {exchange.remains}"
                )
            if exchange.finished > finished:
                finished = exchange.finished
                yield finished
    if code:
        raise GseditError(
            f"{name} {describe_exit(code)}; {exchange.last_lines()}. {exchange.remains}"
        )


def new_exchange(parent: Path | None, names: Sequence[str]) -> Exchange:
    """A new folder in `parent` (None: the system's for temporary files). Raises UsageError."""
    try:
        if parent is not None:
            parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="batch-", dir=parent)).absolute()
        for name in ("input", "output"):
            (folder / name).mkdir()
    except OSError as error:
        raise UsageError(
            f"no folder can be made to exchange pictures in ({error}): is the disk full?"
        ) from error
    return Exchange(folder, tuple(names))


def remove_exchange(exchange: Exchange, parent: Path | None) -> None:
    """Remove the folder, and `parent` if it is then empty."""
    shutil.rmtree(exchange.folder, ignore_errors=True)
    if parent is not None:
        with suppress(OSError):  # an earlier run's folders are not ours to remove
            parent.rmdir()


CELL_PIXELS = 2
"""Pixels of a cell in which views agree: a program has no latent cells. Of 1, 2, 4 and 8, measured
on rendered depth, 2 matches most and comes nearest to the ground truth."""


@dataclass(frozen=True, eq=False)
class Command:
    """An Editor that runs a program for every batch of views. Raises UsageError."""

    run: str
    """The command, as for a shell, with {input} (the folder of unedited pictures) and {output} (the
    folder to fill) in it. Optional: {prompt}; {seed}; {renders}, a folder of what the scene looks
    like now; {masks}, a folder of where the edit belongs (white; everywhere where no region was
    given); {python}, the interpreter that runs gsedit. The folders are absolute and have pictures
    of the same names; the program starts where gsedit was started."""
    timeout: float | None = None
    """Seconds for a batch of views; None: no limit."""
    folder: Path | None = None
    """Folder in which pictures are exchanged; None: the system's place for temporary files. Files
    that a failed program was given, made and wrote stay there."""
    name: str = "command"
    cell: int = CELL_PIXELS
    capabilities: Capabilities = field(default_factory=Capabilities)

    def __post_init__(self) -> None:
        if self.timeout is not None and not self.timeout > 0:
            raise UsageError(f"timeout must be more than 0 seconds, not {self.timeout:g}")
        split_command(self.run)

    def check(self, prompt: str) -> None:
        """Raise UsageError without such a program, or for an instruction it cannot be given."""
        if "{prompt}" in self.run and not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if "\0" in prompt:
            raise UsageError("the instruction has a NUL character in it, which no program is given")
        check_program(split_command(self.run)[0])

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Run the program on the views that are not anchored; a step is a picture it has written.

        The program is ended when the caller leaves early. Raises UsageError where it cannot be
        started, GseditError where it fails or takes too long, InputError for what it left out or
        made of another size; each says where its folders remain.
        """
        self.check(batch.prompt)
        kept = batch.anchored
        free = [i for i in range(len(batch.images)) if kept is None or not kept[i]]
        edited = batch.images.clone()
        if free:
            exchange = new_exchange(self.folder, [f"{view:03d}.png" for view in free])
            self._write(exchange, batch, free)
            arguments = self._arguments(batch, exchange)
            advice = "raise it by --set timeout=SECONDS, or lower --views"
            for finished in run_in(exchange, arguments, self.timeout, advice):
                yield EditProgress(finished, len(free) + 1)
            edited[free] = exchange.read(*batch.images.shape[1:3]).to(edited)
            remove_exchange(exchange, self.folder)
        yield EditProgress(len(free) + 1, len(free) + 1, edited)

    def _write(self, exchange: Exchange, batch: EditBatch, views: list[int]) -> None:
        """The pictures that the command asks for."""
        exchange.write("input", batch.originals[views])
        if "{renders}" in self.run:
            exchange.write("renders", batch.images[views])
        if "{masks}" in self.run:
            everywhere = torch.ones(batch.images.shape[:3])
            masks = (everywhere if batch.subject is None else batch.subject)[views]
            exchange.write("masks", masks[..., None].expand(-1, -1, -1, 3))

    def _arguments(self, batch: EditBatch, exchange: Exchange) -> list[str]:
        values = {
            "input": str(exchange.input),
            "output": str(exchange.output),
            "prompt": batch.prompt,
            "seed": str(batch.seed),
            "renders": str(exchange.folder / "renders"),
            "masks": str(exchange.folder / "masks"),
            "python": sys.executable,
        }
        return fill_fields(split_command(self.run), values)


# ---- masks ---------------------------------------------------------------------------------------

MASK_FIELDS = ("input", "output", "phrase", "python")


@dataclass(frozen=True, eq=False)
class MaskCommand:
    """A MaskProvider that runs a program once for all pictures. Raises UsageError."""

    run: str
    """The command, as for a shell, with {input} (the folder of pictures, PNG) and {output} (the
    folder to fill with masks of the same names: white where it is, black or transparent elsewhere,
    of any size of the same shape) in it. Optional: {phrase}; {python}, the interpreter that runs
    gsedit."""
    name: str = "command"

    def __post_init__(self) -> None:
        split_command(self.run, MASK_FIELDS, MASK_EXAMPLE)

    def check(self, phrase: str) -> None:
        """Raise UsageError without such a program, or for a phrase it cannot be given."""
        if "\0" in phrase:
            raise UsageError("the phrase has a NUL character in it, which no program is given")
        check_program(split_command(self.run, MASK_FIELDS, MASK_EXAMPLE)[0], "--masks-run")

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield a mask a picture; none is yielded before the program has ended.

        Raises UsageError where it cannot be started, GseditError where it fails, InputError for a
        mask that it left out or made of another shape; each says where its folders remain.
        """
        exchange = new_exchange(None, [f"{view:03d}.png" for view in range(len(pictures))])
        exchange.write("input", pictures)
        values = {"input": str(exchange.input), "output": str(exchange.output)}
        values |= {"phrase": phrase, "python": sys.executable}
        words = fill_fields(split_command(self.run, MASK_FIELDS, MASK_EXAMPLE), values)
        for _ in run_in(exchange, words):
            pass
        sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
        made = [read_mask(exchange.made(n), *size) for n, size in zip(exchange.names, sizes)]
        remove_exchange(exchange, None)
        yield from made
