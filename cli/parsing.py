"""Numbers on the command line: 1,2.5,-3."""

from __future__ import annotations

from math import isfinite


def numbers(text: str, option: str, count: int) -> list[float]:
    """`count` finite numbers separated by commas. Raises UsageError."""
    from gsedit.errors import UsageError

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(isfinite, values)):
        example = ",".join("1.5" if i == 0 else str(i) for i in range(count))
        numbers = "a number" if count == 1 else f"{count} numbers separated by commas"
        raise UsageError(f"{option} {text}: give {numbers}, as in {example}")
    return values
