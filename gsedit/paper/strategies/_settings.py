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
    least_noise: float = 0.02
    """Lowest noise level at which an edit starts, a fraction of the schedule; this and the next are
    Instruct-NeRF2NeRF's."""
    most_noise: float = 0.98
    """Highest noise level at which an edit starts, a fraction of the schedule."""
    dataset_views: Literal["all", "planned"] = "all"
    """Views that are edited in turn: all but the held-out ones, or those of the plan."""

    def __post_init__(self) -> None:
        check_steps(self)
        if not 0 < self.least_noise <= self.most_noise <= 1:
            raise UsageError(
                f"noise is drawn from {self.least_noise:g} to {self.most_noise:g}: give fractions "
                "of the schedule above 0 and at most 1, the least one first"
            )


def check_steps(strategy: Any) -> None:
    """Raise UsageError, with the name, for a number of steps below 1."""
    for name, count in vars(strategy).items():
        if "steps" in name and count < 1:
            raise UsageError(f"{name.replace('_', ' ')} must be 1 or more, not {count}")
