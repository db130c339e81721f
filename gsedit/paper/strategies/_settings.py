"""Settings that strategies share. Nothing here or in their own files loads torch: a shell asks for
the options of `gsedit edit` at every Tab."""

from __future__ import annotations

from typing import Literal

from gsedit.errors import UsageError

LEAST_NOISE, MOST_NOISE = 0.02, 0.98
"""Instruct-NeRF2NeRF's bounds of the noise level, as fractions of the schedule."""

DatasetViews = Literal["all", "planned"]


def check_noise(least: float, most: float) -> None:
    """Raise UsageError unless 0 < least <= most <= 1."""
    if not 0 < least <= most <= 1:
        raise UsageError(
            f"noise is drawn from {least:g} to {most:g}: give fractions of the schedule above 0 "
            "and at most 1, the least one first"
        )


def check_positive(**counts: int) -> None:
    """Raise UsageError, with the name, for a count below 1."""
    for name, count in counts.items():
        if count < 1:
            raise UsageError(f"{name.replace('_', ' ')} must be 1 or more, not {count}")
