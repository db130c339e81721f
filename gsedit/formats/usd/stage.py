"""The splats of a USD layer, each with its place: what definitions, transforms and units mean.

Source: the schemas of UsdVol (ParticleField3DGaussianSplat) and UsdGeom in OpenUSD 26.11.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from gsedit.errors import InputError
from gsedit.formats.usd.numbers import NumberList
from gsedit.formats.usd.text import Prim, Span
from gsedit.scene.quaternions import rotation_of
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of

SCHEMA = "ParticleField3DGaussianSplat"
DEGREE = "radiance:sphericalHarmonicsDegree"
COEFFICIENTS = "radiance:sphericalHarmonicsCoefficients"
MAX_DEGREE = 4
WIDTHS = {"positions": 3, "orientations": 4, "scales": 3, "opacities": 1, COEFFICIENTS: 3}
"""Numbers a row of each attribute; each may be under its name, or of half precision, with an h."""


@dataclass(frozen=True)
class Splats:
    """The splats of one definition."""

    path: Path
    name: str
    lists: dict[str, Span]
    """Place of each attribute of WIDTHS; a missing one has the value that the schema gives."""
    degree: int
    count: int
    place: Similarity
    linear: bool = False
    """Whether its light is said to be linear, which gsedit's is not."""

    def list(self, name: str) -> NumberList:
        """The numbers of an attribute of `lists`, from the first on."""
        return NumberList(self.path, self.lists[name], WIDTHS[name], f"{name} of {self.name}")


@dataclass(frozen=True)
class Found:
    """All splats of a layer."""

    splats: tuple[Splats, ...]
    others: int
    """Number of other things that could be drawn: meshes, points, other particle fields."""
    hidden: int
    """Number of definitions of splats that the layer says are invisible."""


_DRAWN = {"Mesh", "Points", "Cube", "Sphere", "Cylinder", "Cone", "Capsule", "BasisCurves",
          "ParticleField", "PointInstancer", "Volume"}  # fmt: skip


def find_splats(layer: Prim, path: Path) -> Found:
    """The splats that are defined below the layer, each with its transform composed.

    Raises InputError for those whose attributes contradict, or that no similarity places.
    """
    splats, others, hidden = [], 0, 0
    for prim, place, shown in _defined(layer, path, np.eye(4), True):
        others += prim.kind in _DRAWN
        if prim.kind == SCHEMA and shown:
            splats.append(_splats(prim, path, place))
        hidden += prim.kind == SCHEMA and not shown
    return Found(tuple(splats), others, hidden)


def _defined(
    prim: Prim, path: Path, above: Float64[np.ndarray, "4 4"], shown: bool
) -> Iterator[tuple[Prim, Float64[np.ndarray, "4 4"], bool]]:
    for child in prim.children:
        if child.specifier != "def" or child.metadata.get("active") in ("false", 0.0):
            continue
        place = placed(child, path, above)
        seen = shown and child.values.get("visibility") != "invisible"
        yield child, place, seen
        yield from _defined(child, path, place, seen)


def _splats(prim: Prim, path: Path, place: Float64[np.ndarray, "4 4"]) -> Splats:
    lists, where = {}, f"{path}: {prim.name}"
    for name in WIDTHS:
        for each in (name, f"{name}h"):
            if f"{each}.timeSamples" in prim.values:
                raise InputError(f"{where}: its {name} change over time: export one moment of it")
            value = prim.values.get(each)
            if value is not None and not isinstance(value, Span):
                raise InputError(f"{where}: its {name} are no list of numbers: export it again")
            if value is not None and name not in lists and value.start < value.end:
                lists[name] = value
    degree = prim.values.get(DEGREE, 3.0)
    if COEFFICIENTS not in lists:
        degree = 0.0
    if degree not in range(MAX_DEGREE + 1):
        raise InputError(f"{where}: an SH degree of {str(degree)[:20]}: 0 to {MAX_DEGREE} are read")
    try:
        similarity = IDENTITY if (place == np.eye(4)).all() else similarity_of(place)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{where} ({error}): export it again") from None
    found = Splats(path, prim.name, lists, int(degree), 0, similarity)
    counts = {name: found.list(name).count() for name in lists}
    count = counts.get("positions", 0)
    for name, rows in counts.items():
        needed = count * (int(degree) + 1) ** 2 if name == COEFFICIENTS else count
        if rows < needed:
            raise InputError(f"{where} has {rows} {name}, {needed} are needed: export it again")
    linear = str(prim.values.get("colorSpace:name", "")).startswith("lin_")
    return Splats(path, prim.name, lists, int(degree), count, similarity, linear)


def placed(prim: Prim, path: Path, above: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
    """Matrix for column vectors that takes a definition's space to the layer's.

    Raises InputError for a transform that changes over time or is none.
    """
    order = prim.values.get("xformOpOrder")
    if not isinstance(order, list):
        return above
    where = f"{path}: {prim.name}"
    matrix = above
    for name in map(str, order):
        if name == "!resetXformStack!":
            matrix = np.eye(4)
            continue
        inverted, name = name.startswith("!invert!"), name.removeprefix("!invert!")
        if f"{name}.timeSamples" in prim.values:
            raise InputError(f"{where}: its {name} changes over time: export one moment of it")
        try:
            step = _step(name.split(":")[1], prim.values[name])
            matrix = matrix @ (np.linalg.inv(step) if inverted else step)
        except (KeyError, IndexError, TypeError, ValueError, np.linalg.LinAlgError):
            raise InputError(f"{where}: its {name[:80]} is no transform: export it again") from None
    return matrix


def _step(kind: str, value: Any) -> Float64[np.ndarray, "4 4"]:
    """Matrix of one step of a transform. Raises KeyError, TypeError or ValueError for no such."""
    numbers = np.array(value, np.float64)
    if not np.isfinite(numbers).all():
        raise ValueError("not finite")
    matrix = np.eye(4)
    if kind == "transform":
        return numbers.reshape(4, 4).T
    if kind == "translate":
        matrix[:3, 3] = numbers.reshape(3)
    elif kind == "scale":
        matrix[:3, :3] = np.diag(numbers.reshape(3))
    elif kind == "orient":
        matrix[:3, :3] = rotation_of(numbers.reshape(4))
    elif kind.startswith("rotate"):
        axes = kind.removeprefix("rotate")
        if not 0 < len(axes) <= 3 or len({*axes}) < len(axes):
            raise KeyError(kind)
        angles = numbers.reshape(3) if len(axes) > 1 else numbers.reshape(1)
        for axis in axes:  # the first turns first
            place = "XYZ".index(axis)
            angle = angles[place] if len(axes) > 1 else angles[0]
            matrix[:3, :3] = _about(place, radians(angle)) @ matrix[:3, :3]
    else:
        raise KeyError(kind)
    return matrix


def _about(axis: int, angle: float) -> Float64[np.ndarray, "3 3"]:
    """Rotation about x, y or z by radians, for column vectors."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[a, a] = turn[b, b] = cos(angle)
    turn[b, a], turn[a, b] = sin(angle), -sin(angle)
    return turn
