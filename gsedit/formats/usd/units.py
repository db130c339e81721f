"""The unit of length and the axis that is up, which a USD stage states and other formats keep as
comments: `metersPerUnit 0.01`, `upAxis Z`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from gsedit.formats.axes import RUB
from gsedit.formats.streams import SceneHeader

_METERS, _UP = "metersPerUnit", "upAxis"
_AXES = {"Y": RUB, "Z": "RFU"}
"""Axes of a stage by the one that is up: x is right; what is up decides which one is front."""


@dataclass(frozen=True)
class Units:
    """Facts that a stage states about its space."""

    meters: float = 1.0
    """Meters in a unit of length; a scene that does not tell counts as one in meters."""
    up: str = "Y"

    @property
    def axes(self) -> str:
        """Name of the axes for `gsedit.formats.axes`."""
        return _AXES[self.up]

    @property
    def comments(self) -> tuple[str, ...]:
        """Comments that say what is not as usual."""
        meters = (f"{_METERS} {self.meters:.9g}",) if self.meters != 1 else ()
        return meters + ((f"{_UP} {self.up}",) if self.up != "Y" else ())


def units_of(stated: Mapping[str, Any]) -> Units:
    """The units that a stage states; X as the axis that is up is no more in USD."""
    meters, up = stated.get(_METERS, 1.0), stated.get(_UP, "Y")
    known = isinstance(meters, float) and isfinite(meters) and meters > 0
    return Units(meters if known else 1.0, up if up in ("Y", "Z") else "Y")


def units_in(comments: Sequence[str]) -> tuple[Units, list[str]]:
    """The units that comments state, and the other comments."""
    meters, up, others = 1.0, "Y", []
    for comment in comments:
        name, _, value = comment.partition(" ")
        if name == _METERS and _number(value) > 0:
            meters = _number(value)
        elif name == _UP and value in _AXES:
            up = value
        else:
            others.append(comment)
    return Units(meters, up), others


def rescaled(header: SceneHeader, factor: float | None) -> SceneHeader:
    """The header of a scene whose lengths were multiplied; None if by what is not known, which
    leaves a scene that does not tell its unit."""
    units, others = units_in(header.comments)
    if units.meters == 1:
        return header
    units = replace(units, meters=units.meters / factor if factor else 1.0)
    return header.replace(comments=(*others, *units.comments))


def _number(text: str) -> float:
    """A finite number; 0 for any other text."""
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if isfinite(value) else 0.0
