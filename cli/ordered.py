"""Options that are steps: they are done in the order in which they stand on the command line."""

from __future__ import annotations

from itertools import count
from typing import Any

import typer

_PLACES = count()


class Step(str):
    """The text of an option, with its place among those of the command line."""

    place: int


def step_option(flag: str, metavar: str, help: str) -> Any:
    """A typer.Option whose parameter is `list[str] | None`: a `Step` if it was given."""
    return typer.Option(flag, metavar=metavar, show_default=False, help=help, callback=_placed)


def in_order(steps: dict[str, list[str] | None]) -> list[tuple[str, str]]:
    """The name and the text of the steps that were given, in their order."""
    given = [(name, texts[0]) for name, texts in steps.items() if texts]
    return sorted(given, key=lambda pair: getattr(pair[1], "place", 0))


def _placed(value: list[str] | None) -> list[Step] | None:
    """typer calls this for the options in the order of the command line."""
    if not value:
        return None
    if len(value) > 1:
        raise typer.BadParameter("given twice: chain the second with then, as in then transform")
    step = Step(value[0])
    step.place = next(_PLACES)
    return [step]
