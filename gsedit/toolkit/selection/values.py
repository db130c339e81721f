"""Selections by value: the numbers of a Gaussian in human units, and comparisons of them."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.base import QUIET, Selection
from gsedit.toolkit.selection.volumes import Vector, check_finite

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
