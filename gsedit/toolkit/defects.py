"""Every defect that a Gaussian can have: its law, its threshold, why that threshold, what mends it.

`n` Gaussians. No renderer can draw what has the first group, and `load` refuses it; `repair` mends
it. What has the second can be drawn, and is no part of what was captured; `clean` removes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Shaped, UInt64

from gsedit.formats.validity import without_turn, wrong_values
from gsedit.scene.table import SPLAT_FIELDS, SplatTable

Rows = Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class Defect:
    """One thing that can be wrong with a Gaussian."""

    name: str
    law: str
    """Criterion in words; `{:g}` in it is the threshold."""
    mend: str
    """The command that mends it, and how."""
    threshold: float = 0.0
    """In the unit that the law names; of no meaning where the law has no number."""
    reason: str = ""
    """Reason for this threshold, in words."""

    @property
    def sentence(self) -> str:
        """The law with its threshold."""
        return self.law.format(self.threshold)


POSITION = Defect("position", "x, y or z is NaN or beyond 1e9", "clean --repair removes it")
ROTATION = Defect(
    "rotation",
    "the quaternion is zero, NaN or infinite",
    "clean --repair: identity where it is round (scales within a factor of 2), else removed",
    2.0,
    "how a ball is turned cannot be seen, how a disc is turned can",
)
SCALE = Defect(
    "scale",
    "a scale is NaN, zero, or above 1e9",
    "clean --repair: zero becomes the smallest float, others are removed",
)
OPACITY = Defect(
    "opacity",
    "the opacity's logit is NaN or infinite",
    "clean --repair: an infinite one becomes 15 or -15, NaN is removed",
)
COLOR = Defect("color", "f_dc is NaN or beyond 65,504", "clean --repair removes it")
HARMONICS = Defect("harmonics", "f_rest is NaN or beyond 65,504", "clean --repair sets it to 0")
INVALID = (POSITION, ROTATION, SCALE, OPACITY, COLOR, HARMONICS)

DUPLICATE = Defect("duplicate", "every number equals that of an earlier row", "clean removes it")
INVISIBLE = Defect(
    "invisible",
    "opacity below {:.4f}",
    "clean removes it",
    1 / 255,
    "one step of an 8-bit picture: renderers skip it, so that nothing changes without it",
)
GIANT = Defect(
    "giant",
    "a standard deviation above {:g} times the scene's radius, and the middle of the scene within "
    "2 standard deviations",
    "clean removes it",
    1.0,
    "fog before every camera; a sky is as large, and the scene is not inside its splats",
)
FLOATER = Defect(
    "floater",
    "its 8th neighbor is {:g} times as far as theirs, or farther than the scene's radius, and "
    "more than 2 standard deviations of its own away",
    "clean removes it",
    5.0,
    "on a surface the distance varies by less than 2; at 3, well-fitted scenes lose 0.1 % and "
    "more, at 5 at most 0.07 %",
)
NEEDLE = Defect(
    "needle",
    "longest to middle axis above {:g}, 2 standard deviations longer than 4 distances to the 8th "
    "neighbor and than 8 % of the scene's radius, and an end in the open",
    "clean removes it",
    5.0,
    "thin ones that follow an edge or a string are healthy: their ends touch others; a short one "
    "is no streak in a picture",
)
UNSEEN = Defect(
    "unseen",
    "it adds less than {:.4f} of a pixel to what each camera sees",
    "clean removes it, where the cameras are known",
    1 / 255,
    "one step of an 8-bit picture in a single pixel: no photo says anything of it, and a view from "
    "elsewhere shows it in front of what is right",
)
DEFECTS = (DUPLICATE, INVISIBLE, GIANT, FLOATER, NEEDLE, UNSEEN)
"""Defects that `clean` removes, in order of priority: a Gaussian has the first that fits."""


def invalid(table: SplatTable) -> dict[str, Rows]:
    """The rows with each defect of INVALID, by its name; a row may have several."""
    wrong = wrong_values(table)
    return {
        POSITION.name: wrong["means"].any(1),
        ROTATION.name: wrong["quats"].any(1) | without_turn(table),
        SCALE.name: wrong["log_scales"].any(1),
        OPACITY.name: wrong["logit_opacities"],
        COLOR.name: wrong["sh"][:, 0].any(1),
        HARMONICS.name: wrong["sh"][:, 1:].any((1, 2)),
    }


def invisible(table: SplatTable, least: float = INVISIBLE.threshold) -> Rows:
    """The rows of an opacity below `least`."""
    return table.opacities < least


def fingerprints(table: SplatTable) -> UInt64[np.ndarray, " n"]:
    """A number of 64 bits for each row: equal for equal rows, and for others at 1 in 10^19."""
    draw = np.random.default_rng(0)
    total = np.zeros(len(table), np.uint64)
    for name in SPLAT_FIELDS:
        numbers = np.asarray(getattr(table, name), np.float32)
        for column in numbers.reshape(len(table), int(np.prod(numbers.shape[1:]))).T:
            # mixed, so that sums of several columns rarely agree
            bits = column.copy().view(np.uint32).astype(np.uint64)
            factor, shift = draw.integers(1, 1 << 63, 2, dtype=np.uint64) | np.uint64(1)
            mixed = (bits + shift) * factor
            total += (mixed ^ (mixed >> np.uint64(29))) * factor
    return total


def repeated(keys: Shaped[np.ndarray, " n"]) -> Rows:
    """The rows whose key an earlier row has."""
    order = np.argsort(keys, kind="stable")
    again = np.zeros(len(keys), bool)
    again[order[1:]] = keys[order[1:]] == keys[order[:-1]]
    return again
