"""Settings that strategies share. Nothing here or in their own files loads torch: a shell asks for
the options of `gsedit edit` at every Tab."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from gsedit.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class DatasetUpdate:
    """Settings of the dataset update, in which views are edited one by one."""

    steps_between: int = 10
    """Fitting steps after each edited view (N_IU of the paper)."""
    dataset_views: Literal["all", "planned"] = "all"
    """Views that are edited in turn: all but the held-out ones, or those of the plan."""

    def __post_init__(self) -> None:
        check_steps(self)


def check_steps(strategy: Any) -> None:
    """Raise UsageError, with the name, for a number of steps below 1."""
    for name, count in vars(strategy).items():
        if "steps" in name and count < 1:
            raise UsageError(f"{name.replace('_', ' ')} must be 1 or more, not {count}")
