"""The editor `command`: a program is run for every batch, and its pictures are made to agree."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import torch

from gsedit.consistency.harmonise import harmonise
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors.command.exchange import Exchange, new_exchange, remove_exchange
from gsedit.editors.command.program import (
    describe_exit,
    fill_fields,
    running,
    split_command,
    wait,
)
from gsedit.editors.protocol import Capabilities, EditBatch, EditProgress
from gsedit.errors import GseditError, UsageError

CELL = 2
"""Pixels of a cell in which views agree: a program has no latent cells. Of 1, 2, 4 and 8, measured
on rendered depth, 2 matches most and comes nearest to the ground truth."""


@dataclass(frozen=True, eq=False)
class Command:
    """An Editor that runs a program for every batch of views. Raises UsageError."""

    run: str
    """The command, as for a shell, with {input} and {output} in it, {prompt} and {seed} optional.
    The folders are absolute; the program starts where gsedit was started."""
    timeout: float | None = None
    """Seconds for a batch of views; None: no limit."""
    folder: Path | None = None
    """Where folders are exchanged; None: the system's place for temporary files. What a program
    that failed was given, made and wrote stays there."""
    name: str = "command"
    cell: int = CELL
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
        if shutil.which(program) is None:
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
            exchange.write(batch.originals[free])
            for finished in self._run(batch, exchange):
                yield EditProgress(finished, len(free) + 1)
            edited[free] = exchange.read(*batch.images.shape[1:3]).to(edited)
            remove_exchange(exchange, self.folder)
        if batch.correspondences is not None and settings.consensus:
            edited = harmonise(
                edited,
                batch.correspondences,
                anchored=batch.anchored,
                strength=settings.consensus_strength,
            )
        yield EditProgress(len(free) + 1, len(free) + 1, edited)

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
        }
        return fill_fields(split_command(self.run), values)


def _free(batch: EditBatch) -> list[int]:
    """The views that are to be edited."""
    if batch.anchored is None:
        return list(range(len(batch.images)))
    return torch.nonzero(~batch.anchored).squeeze(1).tolist()
