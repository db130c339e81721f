"""The mask provider `command`: a program that finds what a phrase names in pictures."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from gsedit.editors.command.exchange import new_exchange, remove_exchange, run_in
from gsedit.editors.command.program import check_program, fill_fields, split_command
from gsedit.errors import UsageError
from gsedit.select.drawn import read_mask

FIELDS = ("input", "output", "phrase", "python")
OPTION = "--masks-run"
EXAMPLE = f'{OPTION} "my_segmenter {{input}} {{output}} {{phrase}}"'


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
        split_command(self.run, FIELDS, EXAMPLE)

    def check(self, phrase: str) -> None:
        """Raise UsageError without such a program, or for a phrase it cannot be given."""
        if "\0" in phrase:
            raise UsageError("the phrase has a NUL character in it, which no program is given")
        check_program(split_command(self.run, FIELDS, EXAMPLE)[0], OPTION)

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
        words = fill_fields(split_command(self.run, FIELDS, EXAMPLE), values)
        for _ in run_in(exchange, words):
            pass
        sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
        made = [read_mask(exchange.made(n), *size) for n, size in zip(exchange.names, sizes)]
        remove_exchange(exchange, None)
        yield from made
