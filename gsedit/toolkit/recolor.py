"""Colors and opacities of selected Gaussians, changed as in a photo editor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import isfinite

import numpy as np
from jaxtyping import Bool

from gsedit.errors import UsageError
from gsedit.scene.table import SplatTable
from gsedit.select.rules import EVERYTHING, Selection
from gsedit.toolkit.color_maps import ColorMap, mapped
from gsedit.toolkit.filter import as_selection
from gsedit.toolkit.grade import CurvePoints, Grade, curved
from gsedit.toolkit.operation import OnSelection, Scene, apply

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
