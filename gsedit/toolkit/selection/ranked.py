"""Selections by rank: the n largest or smallest by a value, or the first n per cent."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import ceil

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable
from gsedit.toolkit.selection.base import QUIET, WholeSelection
from gsedit.toolkit.selection.values import Value


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
