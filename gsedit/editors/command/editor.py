"""The editor `command`: a program is run for every batch, and its pictures are made to agree."""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.harmonise import harmonise
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import Capabilities, EditBatch, EditProgress
from gsedit.editors.command.program import (
    describe_exit,
    fill_fields,
    running,
    split_command,
    wait,
)
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.pictures import as_picture, read_picture

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
            raise UsageError(f"--timeout must be more than 0 seconds, not {self.timeout:g}")
        split_command(self.run)

    def check(self, prompt: str) -> None:
        """Raise UsageError without such a program, or for an instruction it cannot be given."""
        if "{prompt}" in self.run and not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if "\0" in prompt:
            raise UsageError("the instruction has a NUL character in it, which no program is given")
        program = split_command(self.run)[0]
        if program != "{python}" and shutil.which(program) is None:
            raise UsageError(
                f"there is no program {program!r} to run: install it, or give its whole path in "
                "--run (a script must be executable, or be given to its interpreter: "
                "'python script.py ...')"
            )

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
        edited = batch.images.clone()
        if free:
            exchange = new_exchange(self.folder, [f"{view:03d}.png" for view in free])
            self._write(exchange, batch, free)
            for finished in self._run(batch, exchange):
                yield EditProgress(finished, len(free) + 1)
            edited[free] = exchange.read(*batch.images.shape[1:3]).to(edited)
            remove_exchange(exchange, self.folder)
        if batch.correspondences is not None and settings.consensus:
            edited = harmonise(
                edited,
                batch.correspondences,
                anchored=batch.anchored,
                strength=settings.consensus_weight,
            )
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

    def _run(self, batch: EditBatch, exchange: Exchange) -> Iterator[int]:
        """Run the program to its end; yields the number of pictures whenever it has grown."""
        arguments = self._arguments(batch, exchange)
        name = Path(arguments[0]).name
        deadline = None if self.timeout is None else time.monotonic() + self.timeout
        finished = 0
        with (
            exchange.stdout.open("wb") as stdout,
            exchange.stderr.open("wb") as stderr,
            running(arguments, stdout, stderr) as program,
        ):
            while (code := wait(program)) is None:
                if deadline is not None and time.monotonic() > deadline:
                    raise GseditError(
                        f"{name} was stopped after {self.timeout:g} s: raise --timeout or lower "
                        f"--views. {exchange.remains}"
                    )
                if exchange.finished > finished:
                    finished = exchange.finished
                    yield finished
        if code:
            raise GseditError(
                f"{name} {describe_exit(code)}; {exchange.last_lines()}. {exchange.remains}"
            )

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


def _free(batch: EditBatch) -> list[int]:
    """The views that are to be edited."""
    if batch.anchored is None:
        return list(range(len(batch.images)))
    return torch.nonzero(~batch.anchored).squeeze(1).tolist()


QUOTED = 5  # last lines of a failed program's output


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
                lines = deque((line.strip() for line in file if line.strip()), QUOTED)
            if lines:
                return f"it said: {' | '.join(lines)}"
        return "it said nothing"

    def write(self, inside: str, images: Float[Tensor, "v h w 3"]) -> None:
        """The pictures as 8-bit PNGs into the folder `inside` this one."""
        place = self.folder / inside
        place.mkdir(exist_ok=True)
        for image, name in zip(images, self.names, strict=True):
            as_picture(image).save(place / name)

    def read(self, height: int, width: int) -> Float[Tensor, "v {height} {width} 3"]:
        """The pictures in `output`. Raises InputError naming the first bad one."""
        return torch.stack([self._read(name, height, width) for name in self.names])

    def _read(self, name: str, height: int, width: int) -> Float[Tensor, "{height} {width} 3"]:
        path = self.output / name
        if not path.is_file():
            others = sorted(p.name for p in self.output.iterdir() if p.name not in self.names)
            wrote = f" (it wrote {', '.join(others[:3])})" if others else ""
            raise InputError(
                f"the program ended well but made no {name}{wrote}: {{output}} needs a picture of "
                f"the same name for every one in {{input}}. {self.remains}"
            )
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
