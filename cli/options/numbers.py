"""Numbers in the text of an option."""

from __future__ import annotations

from math import isfinite

from gsedit.errors import UsageError


def numbers(flag: str, text: str, *counts: int) -> list[float]:
    """Read finite numbers separated by commas, one of `counts` of them. Raises UsageError."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) not in counts or not all(map(isfinite, found)):
        one = counts == (1,)
        many = "a finite number" if one else f"{' or '.join(map(str, counts))} finite numbers"
        raise UsageError(f"{flag} {text}: give {many}{'' if one else ' separated by commas'}")
    return found


def parse_indices(text: str, option: str) -> list[int]:
    """Read whole numbers separated by commas, as in `--views 0,8,16`. Raises UsageError."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(
            f"{option} {text}: give numbers separated by commas, as in 0,8,16"
        ) from None
