"""The folders that pictures are exchanged in with a program, and its run to the end."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.command.program import describe_exit, running, wait
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.pictures import as_picture, read_picture

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
