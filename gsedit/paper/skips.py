"""Decisions to skip a part of the work of an edit, each with its error; as text for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

DecisionName = Literal["merging", "views"]
DECISIONS: tuple[str, ...] = get_args(DecisionName)
"""Names of the decisions, in the order in which they are listed."""

TERMINAL_COLUMNS = 80
NAME_COLUMNS = 18
DISABLED = "Not decided: --disable names it"


@dataclass(frozen=True)
class Decision:
    """Whether one kind of work is skipped in the edit of one scene, and why."""

    name: DecisionName
    applies: bool
    """Whether anything is skipped here; if not, the work is needed, or there is none of it."""
    reason: str
    skipped: str = ""
    """Number of skipped things, out of all of their kind."""
    saving: float = 0.0
    """Estimated share of `saves` that is not done, in [0, 1]."""
    saves: str = ""
    """The work that `saving` is a share of."""
    error: float | None = None
    """Estimate of the mean difference that it makes to a pixel's color, in [0, 1], over all views.
    It is no bound; None where nothing is skipped, or nothing is estimated."""

    def describe(self) -> str:
        """The decision with its reason, saving and error, for a person."""
        if not self.applies:
            return f"{self.reason}."
        parts = [self.skipped] if self.skipped else []
        error = "Error measured, not estimated"
        if self.error is not None:
            error = f"Error about {self.error:.2g} of a pixel's color on average, no bound"
        parts += [self.reason, f"Saves {self.saving:.0%} of {self.saves}", error]
        return ". ".join(parts) + "."


def screen(decisions: Iterable[Decision]) -> str:
    """All decisions as lines of at most 80 columns, those that apply first."""
    ordered = sorted(decisions, key=lambda each: not each.applies)
    blocks = []
    for each in ordered:
        mark = "-" if each.applies else " "
        head = f"{mark} {each.name}".ljust(NAME_COLUMNS)
        columns = TERMINAL_COLUMNS - NAME_COLUMNS
        text = textwrap.wrap(each.describe(), columns, break_on_hyphens=False)
        blocks.append(head + f"\n{' ' * NAME_COLUMNS}".join(text))
    return "\n".join(blocks)


def one_line(decisions: Iterable[Decision]) -> str:
    """The decisions that apply and what they skip, for a log."""
    listed = (
        f"{each.name} ({each.skipped})" if each.skipped else each.name
        for each in decisions
        if each.applies
    )
    return f"skipped: {', '.join(listed) or 'nothing'}"


def decide_views(
    edited: int, budget: int, coverage: float, wanted: float, *, needs_all: bool
) -> Decision:
    """Whether views of the `budget` are not edited, since the `edited` ones cover enough.

    `needs_all`: the strategy edits or renders all views.

    The error is estimated as what Gaussians that are not covered carry: 1 - coverage of all
    blending weights, and so of all pixels. It is no bound: the covered ones change as well, where
    fewer pictures decide their colors. Solved edits differed by 0.2 to 2.2 times as much.
    """
    if needs_all:
        return Decision("views", False, "Needed: the strategy edits or renders all of them")
    if edited == budget:
        reason = f"{edited} views cover {coverage:.0%}, {wanted:.0%} are wanted"
        return Decision("views", False, f"Needed: {reason}")
    return Decision(
        "views",
        True,
        f"{edited} views show well {coverage:.1%} of what all show",
        f"{budget - edited:,} of {budget:,} views that may be edited",
        1 - edited / budget,
        "the editing and the update",
        1 - coverage,
    )
