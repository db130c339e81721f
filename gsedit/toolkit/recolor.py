"""Colors and opacities of selected Gaussians, changed as in a photo editor.

The palette of a picture comes by sliced optimal transport: a map that gives one set of colors the
distribution of another. `n` colors of a scene with weights, `m` of a picture, `k` quantiles.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32

from gsedit.errors import InputError, UsageError
from gsedit.scene.color_space import lab_of_srgb, srgb_of_lab
from gsedit.scene.table import SplatTable
from gsedit.select.selection import EVERYTHING, Selection
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.grade import ColorMap, CurvePoints, Grade, as_table, curved, mapped
from gsedit.toolkit.operation import OnSelection, Say, Scene, Whole, apply

FAINTEST = 1e-6
"""Opacity that stands for 0, and its distance from 1 that stands for 1: logits stay finite."""


@dataclass(frozen=True)
class Recolor(OnSelection):
    """Grade the selected Gaussians."""

    grade: Grade

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        after = recolored(table, inside, self.grade.affine)
        if self.grade.curve:
            after = recolored(after, inside, partial(curved, points=self.grade.curve))
        return after


@dataclass(frozen=True)
class Opacity(OnSelection):
    """Set the opacity of the selected Gaussians, if `value` is given, then multiply it by `scale`.

    The result is clipped to [0, 1]. Raises UsageError for values out of range.
    """

    value: float | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.value is not None and not 0 <= self.value <= 1:
            raise UsageError(f"opacity {self.value:g}: give a number from 0 to 1")
        if not (isfinite(self.scale) and self.scale >= 0):
            raise UsageError(f"opacity scale {self.scale:g}: give a factor of 0 or more")

    def change(self, table: SplatTable, inside: Bool[np.ndarray, " n"]) -> SplatTable:
        before = table.logit_opacities[inside].astype(np.float64)
        with np.errstate(over="ignore"):
            opacities = 1 / (1 + np.exp(-before))
        if self.value is not None:
            opacities = np.where(np.isnan(before), np.nan, self.value)
        opacities = np.clip(self.scale * opacities, FAINTEST, 1 - FAINTEST)
        logits = table.logit_opacities.copy()
        logits[inside] = np.log(opacities / (1 - opacities))
        return table.replace(logit_opacities=logits)


def recolored(table: SplatTable, inside: Bool[np.ndarray, " n"], color_map: ColorMap) -> SplatTable:
    """The table with the colors inside mapped; the others' coefficients are the same bits."""
    if inside.all():
        return table.replace(sh=mapped(table.sh, color_map))
    sh = table.sh.copy()
    sh[inside] = mapped(table.sh[inside], color_map)
    return table.replace(sh=sh)


def recolor(
    scene: Scene,
    *,
    temperature: float = 6500.0,
    tint: float = 0.0,
    exposure: float = 0.0,
    contrast: float = 1.0,
    saturation: float = 1.0,
    hue: float = 0.0,
    curve: CurvePoints = (),
    where: Selection | str = EVERYTHING,
) -> Scene:
    """The scene with the selected Gaussians graded; see `Grade` for the values.

    A text for `where` is an expression, as in `opacity > 0.1`. Raises UsageError.
    """
    grade = Grade(temperature, tint, exposure, contrast, saturation, hue, curve)
    return apply(scene, Recolor(grade, selection=as_selection(where)))


QUANTILES = 64
"""Quantiles of a step along one axis; between them the map is straight."""
DIRECTIONS = 64
"""Random directions along which a distance of colors is measured."""


def color_transport(
    source: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"],
    target: Float[np.ndarray, "m 3"],
    strength: float = 1.0,
) -> ColorMap:
    """The map of `source` colors, of these weights, to those of a picture, of which `strength` is
    done; sRGB to sRGB, clipped to [0, 1].

    Iterative distribution transfer (Pitie et al. 2007), which descends the sliced Wasserstein
    distance (Rabin et al. 2011): along random axes, quantiles are moved to quantiles.
    """
    generator = np.random.default_rng(0)
    points, goal = lab_of_srgb(np.clip(source, 0, 1)), lab_of_srgb(target)
    steps = []
    for _ in range(24):
        axes = np.linalg.qr(generator.standard_normal((3, 3)))[0].T
        before = np.stack([quantiles(p, weights) for p in (points @ axes.T).T])
        after = np.stack([quantiles(p, np.ones(len(goal))) for p in (goal @ axes.T).T])
        steps.append((axes, before + 1e-9 * np.arange(QUANTILES), after))  # knots must rise
        points = _transported(points, *steps[-1])

    def moved(srgb: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        lab = start = lab_of_srgb(np.clip(np.asarray(srgb, np.float64), 0, 1))
        for step in steps:
            lab = _transported(lab, *step)
        return np.clip(srgb_of_lab(start + strength * (lab - start)), 0, 1)

    return moved


def _transported(
    points: Float[np.ndarray, "n 3"],
    axes: Float[np.ndarray, "3 3"],
    before: Float[np.ndarray, "3 k"],
    after: Float[np.ndarray, "3 k"],
) -> Float[np.ndarray, "n 3"]:
    """Points after a step along three orthogonal axes (rows), quantiles before to those after."""
    along = points @ axes.T
    moved = [_continued(*each) for each in zip(along.T, before, after)]
    return points + (np.stack(moved, -1) - along) @ axes


def quantiles(
    values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"], count: int = QUANTILES
) -> Float[np.ndarray, " k"]:
    """Values below which the fractions 0.5/k, 1.5/k, ... of the weight lie; some weight is above
    0."""
    values, weights = values[weights > 0], weights[weights > 0]
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    middle = (below - weights[order] / 2) / below[-1]
    return np.interp((np.arange(count) + 0.5) / count, middle, values[order])


def _continued(
    values: Float[np.ndarray, " n"], before: Float[np.ndarray, " k"], after: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """Straight pieces through the knots; beyond them, at their mean slope, or 1 if it is more."""
    inside = np.clip(values, before[0], before[-1])
    slope = min(1.0, np.ptp(after) / max(np.ptp(before), 1e-12))
    return np.interp(inside, before, after) + slope * (values - inside)


def sliced_distance(
    a: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"], b: Float[np.ndarray, "m 3"]
) -> float:
    """Sliced Wasserstein-2 distance of two sets of sRGB colors, in units of Lab (a difference of
    1 to 2 is just seen).

    The root of the mean over random directions of the squared difference of 256 quantiles.
    """
    axes = np.random.default_rng(1).standard_normal((DIRECTIONS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    here, there = (lab_of_srgb(np.clip(each, 0, 1)) @ axes.T for each in (a, b))
    even = np.ones(len(b))
    squares = [
        np.mean((quantiles(p, weights, 256) - quantiles(q, even, 256)) ** 2)
        for p, q in zip(here.T, there.T)
    ]
    return float(np.sqrt(np.mean(squares)))


PICTURE_SIZE = 256
"""Longer side that a picture is reduced to, pixels: its colors hardly change."""


@dataclass(frozen=True)
class Palette(Whole):
    """Give the selected Gaussians the colors of a picture, by sliced optimal transport in Lab.

    A Gaussian counts by its opacity. Colors that were equal stay equal.
    """

    picture: Path
    strength: float = 1.0
    """Share of the way to the other palette in Lab, 0 to 1."""
    selection: Selection = field(default=EVERYTHING, kw_only=True)

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UsageError(f"strength {self.strength:g}: give a number from 0 to 1")
        read_colors(self.picture)

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        inside = self.selection.mask(table)
        drawn = (table.opacities > 0) & np.isfinite(table.colors).all(1)
        rows = np.flatnonzero(inside & drawn)
        if not len(rows):
            raise UsageError("nothing that can be seen is selected: there are no colors to change")
        sample = rows[:: -(-len(rows) // (1 << 17))]
        colors, weights = table.colors[sample], table.opacities[sample]
        goal = read_colors(self.picture)
        transport = color_transport(colors, weights, goal, self.strength)
        after = recolored(table, inside, as_table(transport))
        distances = [sliced_distance(each.colors[sample], weights, goal) for each in (table, after)]
        say(
            f"distance of the colors from those of {self.picture.name} (sliced Wasserstein, Lab): "
            f"{distances[0]:.1f}, now {distances[1]:.1f}"
        )
        return after


def read_colors(path: Path) -> Float32[np.ndarray, "m 3"]:
    """The colors of a picture, sRGB in [0, 1]; transparent pixels are left out.

    Raises InputError for a file that is no picture, or that is transparent throughout.
    """
    from gsedit.formats.pictures import open_picture

    with open_picture(path) as picture:
        rgba = picture.convert("RGBA")
        rgba.thumbnail((PICTURE_SIZE, PICTURE_SIZE))
        pixels = np.asarray(rgba, np.float32).reshape(-1, 4) / 255
    seen = pixels[pixels[:, 3] > 0.5, :3]
    if not len(seen):
        raise InputError(f"{path} is transparent throughout: it has no colors")
    return seen
