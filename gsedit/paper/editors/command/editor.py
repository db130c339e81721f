"""The editor and the mask provider `command`: a program is run for every batch of pictures."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.command import MASK_EXAMPLE
from gsedit.paper.editors.command.program import (
    Exchange,
    check_program,
    fill_fields,
    new_exchange,
    remove_exchange,
    run_in,
    split_command,
)
from gsedit.paper.protocol import Capabilities, EditBatch, EditProgress
from gsedit.select.masked import read_mask

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
        free = _free(batch)
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


def _free(batch: EditBatch) -> list[int]:
    """The views that are to be edited."""
    if batch.anchored is None:
        return list(range(len(batch.images)))
    return torch.nonzero(~batch.anchored).squeeze(1).tolist()


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
