"""A decision to leave out a part of the work of an edit, and how it reads on a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

DecisionName = Literal[
    "cells", "gaussians", "sh-bands", "geometry", "views", "resolution", "depth",
    "correspondences", "crops", "densification",
]  # fmt: skip
DECISIONS: tuple[str, ...] = get_args(DecisionName)
"""In the order in which they are listed."""

COLUMNS = 80
"""Of a terminal: longer lines are folded."""
INDENT = 18


@dataclass(frozen=True)
class LeftOut:
    """Some of many things."""

    count: int
    of: int
    what: str
    """What they are, in the plural."""

    def __str__(self) -> str:
        return f"{self.count:,} of {self.of:,} {self.what}"


@dataclass(frozen=True)
class Bound:
    """The largest difference that a decision can make."""

    value: float
    unit: str
    """Of the value, and what it is measured on. Colours are in [0, 1]."""

    def __str__(self) -> str:
        return f"{self.value:.2g} {self.unit}" if self.value else "0: nothing changes"


@dataclass(frozen=True)
class Decision:
    """Whether one kind of work is left out of the edit of one scene."""

    name: DecisionName
    applies: bool
    """Whether anything is left out here; if not, the work is needed, or there is none of it."""
    reason: str
    left_out: tuple[LeftOut, ...] = ()
    saving: float = 0.0
    """Share of `saves`, in [0, 1], estimated."""
    saves: str = ""
    """What the saving is a share of."""
    bound: Bound | None = None
    """None where nothing is left out, or no bound is known (docs/plan.md has what was measured)."""

    def describe(self) -> str:
        """All of it, for a person."""
        if not self.applies:
            return f"{self.reason}."
        parts = [", ".join(map(str, self.left_out))] if self.left_out else []
        error = f"Error at most {self.bound}" if self.bound else "Error measured, not bounded"
        parts += [self.reason, f"Saves {self.saving:.0%} of {self.saves}", error]
        return ". ".join(parts) + "."


def screen(decisions: Iterable[Decision]) -> str:
    """All decisions, those that apply first, in lines of at most 80 columns."""
    ordered = sorted(decisions, key=lambda each: not each.applies)
    blocks = []
    for each in ordered:
        mark = "-" if each.applies else " "
        head = f"{mark} {each.name}".ljust(INDENT)
        text = textwrap.wrap(each.describe(), COLUMNS - INDENT, break_on_hyphens=False)
        blocks.append(head + f"\n{' ' * INDENT}".join(text))
    return "\n".join(blocks)


def one_line(decisions: Iterable[Decision]) -> str:
    """What is left out, for a log."""
    applied = [each for each in decisions if each.applies]
    listed = (
        f"{each.name} ({'; '.join(map(str, each.left_out))})" if each.left_out else each.name
        for each in applied
    )
    return f"left out: {', '.join(listed)}" if applied else "left out: nothing"
