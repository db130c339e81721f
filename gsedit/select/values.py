"""Numbers that every Gaussian has, by name or arithmetic; selections by comparison or rank."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from math import ceil, isfinite
from typing import Any

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.table import SplatTable
from gsedit.select.selection import QUIET, Flags, Selection


@dataclass(frozen=True, eq=False)
class Value:
    """A number that every Gaussian has."""

    of: Callable[[SplatTable], Any]
    """One number a row, of any type; or one number for all rows."""
    number: float | None = None
    """The number that is equal for all Gaussians; None for another value."""


NAMED: dict[str, tuple[str, Callable[[SplatTable], Any]]] = {
    "x": ("coordinate of the center", lambda table: table.means[:, 0]),
    "y": ("coordinate of the center", lambda table: table.means[:, 1]),
    "z": ("coordinate of the center", lambda table: table.means[:, 2]),
    "opacity": ("0 to 1", lambda table: table.opacities),
    "size": (
        "geometric mean of the three standard deviations",
        lambda table: np.exp(table.log_scales.mean(1)),
    ),
    "longest": ("largest standard deviation", lambda table: np.exp(table.log_scales.max(1))),
    "shortest": ("smallest standard deviation", lambda table: np.exp(table.log_scales.min(1))),
    "anisotropy": (
        "longest / shortest",
        lambda table: np.exp(table.log_scales.max(1) - table.log_scales.min(1)),
    ),
    "red": ("0 to 1, without view dependence", lambda table: table.colors[:, 0]),
    "green": ("0 to 1, without view dependence", lambda table: table.colors[:, 1]),
    "blue": ("0 to 1, without view dependence", lambda table: table.colors[:, 2]),
    "luminance": (  # the luma of Rec. 709
        "0.2126 red + 0.7152 green + 0.0722 blue",
        lambda table: table.colors @ np.array((0.2126, 0.7152, 0.0722), np.float32),
    ),
}
"""Values by name: what each is, and how it is computed. Lengths are in units of the scene."""


def value_named(name: str) -> Value:
    """A value of `NAMED`, or else an extra column of the file."""
    return Value(NAMED[name][1]) if name in NAMED else column(name)


def column(name: str) -> Value:
    """An extra column of the file."""

    def of(table: SplatTable) -> Any:
        if name in table.extra:
            return table.extra[name]
        known = [*NAMED, *table.extra]
        close = get_close_matches(name, known, 1)
        move = f"did you mean {close[0]}?" if close else f"the scene has {', '.join(known)}"
        raise UsageError(f"no value and no column of the scene is named {name}: {move}")

    return Value(of)


def check_finite(form: str, *numbers: float) -> None:
    """Raise UsageError for a number that is infinite or none."""
    if not all(map(isfinite, numbers)):
        raise UsageError(f"{form}: {', '.join(f'{n:g}' for n in numbers)} are not all finite")


def distance(x: float, y: float, z: float) -> Value:
    """From x,y,z to the center."""
    check_finite("distance", x, y, z)
    point = np.array((x, y, z), np.float32)
    return Value(lambda table: np.linalg.norm(table.means - point, axis=1))


def absolute(value: Value) -> Value:
    """Absolute value of a number."""
    return computed(abs, value)


def computed(operator: Callable[..., Any], *operands: Value) -> Value:
    """Result of arithmetic on values. Whole numbers become float64: differences of a column of
    bytes would wrap round."""

    def real(numbers: Any) -> Any:
        whole = isinstance(numbers, np.ndarray) and numbers.dtype.kind in "biu"
        return numbers.astype(np.float64) if whole else numbers

    return Value(lambda table: operator(*(real(each.of(table)) for each in operands)))


def compare(left: Value, operator: Callable[[Any, Any], Any], right: Value) -> Selection:
    """Select rows for which `left operator right` holds."""

    def mask(table: SplatTable) -> Flags:
        found = operator(left.of(table), right.of(table))
        return np.broadcast_to(np.asarray(found, bool), len(table))

    return Selection(QUIET(mask))


Amount = Callable[[int], int]
"""Rows of a number of all rows."""


def parse_amount(text: str) -> Amount:
    """The rows of `1000`, or of the share `10 %`, which is rounded up. Raises UsageError."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", text)
    if match is None or (not match[2] and "." in match[1]):
        raise UsageError(f"{text!r} is no amount: give a count, as in 1000, or a share, as in 10%")
    number = float(match[1])
    if match[2] and number > 100:
        raise UsageError(f"{number:g} %: give a count of 0 or more, or 0 % to 100 %")
    return lambda count: min(ceil(number * count / 100) if match[2] else int(number), count)


def largest(amount: Amount, value: Value) -> Selection:
    """The rows with the largest values: 1000 of them, or '10%'."""
    return smallest(amount, Value(lambda table: -np.asarray(value.of(table), np.float64)))


def smallest(amount: Amount, value: Value) -> Selection:
    """The rows with the smallest values: 1000 of them, or '10%'."""

    def mask(table: SplatTable) -> Flags:
        numbers = np.broadcast_to(np.asarray(value.of(table), np.float64), len(table))
        inside = np.zeros(len(table), bool)
        # of equals the first ones, and NaN comes last
        inside[np.argsort(numbers, kind="stable")[: amount(len(table))]] = True
        return inside

    return Selection(QUIET(mask), whole=True)


VALUES: dict[str, Callable[..., Value]] = {"distance": distance, "column": column, "abs": absolute}
"""Functions that give a number a Gaussian, by their names in expressions."""
