"""Traits of a strategy, read from its class: what it needs, and its name.

The protocol itself is gsedit.paper.actions.Strategy.
"""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any

from gsedit.errors import UsageError


def check_strategy(strategy: Any) -> None:
    """Raise UsageError or InputError for what is no strategy, or lacks weights, say."""
    if isinstance(strategy, type) or not is_dataclass(strategy):
        raise UsageError(
            f"{strategy!r} is no strategy: give an instance of a dataclass, as in SinglePass()"
        )
    check = getattr(strategy, "check", None)
    if check is not None:
        check()


def asks_editor(strategy: Any) -> bool:
    """Whether a 2D editor must be able to follow the instruction."""
    return getattr(strategy, "asks_editor", True)


def fits_pictures(strategy: Any) -> bool:
    """Whether it fits the scene to edited pictures alone; others render the optimizer's scene."""
    return getattr(strategy, "fits_pictures", True)


def uses_all_views(strategy: Any) -> bool:
    """Whether it edits or renders views that are not in the plan."""
    return getattr(strategy, "dataset_views", "planned") == "all"


def name_of(strategy: Any) -> str:
    """The name of a strategy, as on the command line."""
    return type(strategy).__module__.rpartition(".")[2].replace("_", "-")
