"""Selections by value, by rank and by color."""

from __future__ import annotations

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.select.rules import QUIET, Selection, WholeSelection
from gsedit.select.volumes import Vector, check_finite, check_positive
from gsedit.storage.inputs import existing_file

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in the luma of Rec. 709."""


class Value(ABC):
    """A number that every Gaussian has."""

    @abstractmethod
    def of(self, table: SplatTable) -> Any:
        """One number a row, of any type; or one number for all rows."""


def _channel(channel: int) -> Callable[[SplatTable], Any]:
    return lambda table: table.colors[:, channel]


def _axis(axis: int) -> Callable[[SplatTable], Any]:
    return lambda table: table.means[:, axis]


def _anisotropy(table: SplatTable) -> Any:
    return np.exp(table.log_scales.max(1) - table.log_scales.min(1))


NAMED: dict[str, tuple[str, Callable[[SplatTable], Any]]] = {
    "x": ("coordinate of the center", _axis(0)),
    "y": ("coordinate of the center", _axis(1)),
    "z": ("coordinate of the center", _axis(2)),
    "opacity": ("0 to 1", lambda table: table.opacities),
    "size": (
        "geometric mean of the three standard deviations",
        lambda table: np.exp(table.log_scales.mean(1)),
    ),
    "longest": ("largest standard deviation", lambda table: np.exp(table.log_scales.max(1))),
    "shortest": ("smallest standard deviation", lambda table: np.exp(table.log_scales.min(1))),
    "anisotropy": ("longest / shortest", _anisotropy),
    "red": ("0 to 1, without view dependence", _channel(0)),
    "green": ("0 to 1, without view dependence", _channel(1)),
    "blue": ("0 to 1, without view dependence", _channel(2)),
    "luminance": (
        "0.2126 red + 0.7152 green + 0.0722 blue",
        lambda table: table.colors @ np.array(LUMA, np.float32),
    ),
}
"""Values by name: what each is, and how it is computed. Lengths are in units of the scene."""


@dataclass(frozen=True)
class Named(Value):
    """A value of `NAMED`, or else an extra column of the file."""

    name: str

    def of(self, table: SplatTable) -> Any:
        if self.name in NAMED:
            return NAMED[self.name][1](table)
        return Column(self.name).of(table)


@dataclass(frozen=True)
class Column(Value):
    """An extra column of the file."""

    name: str

    def of(self, table: SplatTable) -> Any:
        if self.name in table.extra:
            return table.extra[self.name]
        known = [*NAMED, *table.extra]
        close = get_close_matches(self.name, known, 1)
        move = f"did you mean {close[0]}?" if close else f"the scene has {', '.join(known)}"
        raise UsageError(f"no value and no column of the scene is named {self.name}: {move}")


@dataclass(frozen=True)
class Distance(Value):
    """From a point to the center, in units of the scene."""

    point: Vector

    def __post_init__(self) -> None:
        check_finite("distance", *self.point)

    def of(self, table: SplatTable) -> Any:
        return np.linalg.norm(table.means - np.array(self.point, np.float32), axis=1)


@dataclass(frozen=True)
class Number(Value):
    """One number, equal for all Gaussians."""

    number: float

    def of(self, table: SplatTable) -> Any:
        return self.number


ARITHMETIC: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,
    "**": np.power,
    "abs": abs,
}


@dataclass(frozen=True)
class Computed(Value):
    """Result of arithmetic on values."""

    operator: str
    operands: tuple[Value, ...]

    def of(self, table: SplatTable) -> Any:
        return ARITHMETIC[self.operator](*(_real(each.of(table)) for each in self.operands))


def _real(numbers: Any) -> Any:
    """Whole numbers as float64: differences of a column of bytes would wrap round."""
    whole = isinstance(numbers, np.ndarray) and numbers.dtype.kind in "biu"
    return numbers.astype(np.float64) if whole else numbers


COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


@dataclass(frozen=True)
class Compare(Selection):
    """Select rows for which `left operator right` holds."""

    left: Value
    operator: str
    right: Value

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        found = COMPARISONS[self.operator](self.left.of(table), self.right.of(table))
        return np.broadcast_to(np.asarray(found, bool), len(table))


@dataclass(frozen=True)
class Amount:
    """A number of rows, or a share of all."""

    number: float
    per_cent: bool = False

    def __post_init__(self) -> None:
        if not self.number >= 0 or (self.per_cent and self.number > 100):
            raise UsageError(f"{self}: give a count of 0 or more, or 0 % to 100 %")

    def __str__(self) -> str:
        return f"{self.number:g}{' %' if self.per_cent else ''}"

    def of(self, count: int) -> int:
        """Rows of `count`; a share is rounded up."""
        wanted = ceil(self.number * count / 100) if self.per_cent else int(self.number)
        return min(wanted, count)


def parse_amount(text: str) -> Amount:
    """`1000` or `10 %`. Raises UsageError."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", text)
    if match is None or (not match[2] and "." in match[1]):
        raise UsageError(f"{text!r} is no amount: give a count, as in 1000, or a share, as in 10%")
    return Amount(float(match[1]), bool(match[2]))


@dataclass(frozen=True)
class Ranked(WholeSelection):
    """The `amount` of rows with the largest values, or the smallest; of equals, the first ones.

    NaN comes last of both.
    """

    amount: Amount
    value: Value
    largest: bool = True

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        numbers = np.asarray(self.value.of(table), np.float64)
        numbers = np.broadcast_to(-numbers if self.largest else numbers, len(table))
        inside = np.zeros(len(table), bool)
        inside[np.argsort(numbers, kind="stable")[: self.amount.of(len(table))]] = True
        return inside


@dataclass(frozen=True)
class NearColor(Selection):
    """Select colors that differ from a given one by at most `difference` (CIE 1976, in Lab).

    About 2 is just noticeable; 10 is a shade, 30 another hue.
    """

    color: tuple[float, float, float]
    """Red, green and blue, 0 to 1."""
    difference: float = 10.0

    def __post_init__(self) -> None:
        check_positive("near", "difference", self.difference)

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        picked = lab_of_srgb(np.array([self.color]))
        return (
            np.linalg.norm(lab_of_srgb(np.clip(table.colors, 0, 1)) - picked, axis=1)
            <= self.difference
        )


def parse_color(text: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1, of `#rrggbb`, `#rgb`, or of the pixel `PICTURE@COLUMN,ROW`.

    Raises UsageError for another text or a pixel outside, InputError for no picture.
    """
    if "@" in text:
        return _pixel(text)
    digits = text.removeprefix("#")
    if not re.fullmatch(r"[0-9a-fA-F]{3}|[0-9a-fA-F]{6}", digits):
        raise UsageError(f"color {text}: give #rrggbb, as in #a08050, or a pixel, as photo.jpg@8,9")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    red, green, blue = srgb_of_hex(digits).tolist()
    return red, green, blue


def _pixel(text: str) -> tuple[float, float, float]:
    from gsedit.formats.pictures import open_picture

    name, _, place = text.rpartition("@")
    path = existing_file(Path(name).expanduser())
    try:
        column, row = (int(number) for number in place.split(","))
    except ValueError:
        raise UsageError(f"color {text}: name a pixel by column and row: {name}@8,9") from None
    with open_picture(path) as picture:
        shown = np.asarray(picture.convert("RGB"))
    height, width = shown.shape[:2]
    if not (0 <= column < width and 0 <= row < height):
        raise UsageError(f"color {text}: the picture has {width}x{height} pixels, from 0,0")
    red, green, blue = (shown[row, column] / 255).tolist()
    return red, green, blue
