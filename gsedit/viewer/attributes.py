"""What the points of a preview can be coloured by: a number a Gaussian, with name and unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
import torch
from jaxtyping import Float

from gsedit.errors import UsageError
from gsedit.files.table import table_of
from gsedit.points.selection.values import NAMED
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

COLOR = "color"
SELECTION = "selection"
DEPTH = "depth"
CLIPPED = (1.0, 99.0)
"""Percentiles at the ends of a colour bar: a capture's outliers would take the rest of the bar."""

_ON_A_LOG_SCALE = ("size", "longest", "shortest", "anisotropy")
_LENGTHS = ("x", "y", "z", "size", "longest", "shortest")
NAMES = (COLOR, SELECTION, DEPTH, *NAMED)
"""What can be asked for by name; columns of a file beside."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """Numbers to colour by, one a Gaussian."""

    values: Float[np.ndarray, " n"]
    title: str
    """Name and unit, for the colour bar."""
    log: bool
    """Whether the colour bar is logarithmic; the values are then positive."""


def attribute(
    scene: Gaussians, name: str, camera: Camera, extra: Mapping[str, np.ndarray] | None = None
) -> Attribute:
    """The attribute of that name: one of NAMES but `color` and `selection`, a column of `extra`
    (one value a Gaussian), or `f_rest_N` and the other columns of INRIA's .ply.

    Raises UsageError for any other name.
    """
    scene = scene.detach()
    if name == DEPTH:
        depth = camera.project(scene.means.double())[1].cpu().numpy()
        seen = np.where(depth > 0, depth, np.nan)  # what is behind would take half of the bar
        return Attribute(seen, "depth along the view of the first picture, scene units", False)
    if name in NAMED:
        what, values = NAMED[name]
        unit = ", scene units" if name in _LENGTHS else ""
        numbers = np.asarray(values(table_of(scene)), dtype=np.float64)
        return Attribute(numbers, f"{name}: {what}{unit}", name in _ON_A_LOG_SCALE)
    if extra and name in extra:
        return Attribute(
            np.asarray(extra[name], dtype=np.float64), f"{name}, as in the file", False
        )
    if (column := stored_column(scene, name)) is not None:
        return Attribute(column.double().cpu().numpy(), f"{name}, as in INRIA's .ply", False)
    known = (*NAMES, *(extra or ()))
    close = get_close_matches(name, known, 1)
    move = (
        f"did you mean {close[0]}?" if close else f"choose one of {', '.join(known)}, f_dc_0, ..."
    )
    raise UsageError(f"there is nothing named '{name}' to colour by: {move}")


def stored_column(scene: Gaussians, name: str) -> torch.Tensor | None:
    """The column of INRIA's .ply of that name, as it is stored; None where there is none."""
    stem, _, number = name.rpartition("_")
    if not number.isdigit():
        return None
    fields = {
        "f_dc": scene.sh[:, 0],
        # channel-major: all coefficients of red, then of green, then of blue
        "f_rest": scene.sh[:, 1:].transpose(1, 2).flatten(1),
        "scale": scene.log_scales,
        "rot": scene.quats,
    }
    field = fields.get(stem)
    if field is None or int(number) >= field.shape[1]:
        return None
    return field[:, int(number)]


def limits(attributes: list[Attribute]) -> tuple[float, float]:
    """The ends of one colour bar for all of them: the CLIPPED percentiles."""
    values = np.concatenate([each.values for each in attributes])
    values = values[np.isfinite(values)]
    low, high = np.percentile(values, CLIPPED) if len(values) else (0.0, 0.0)
    if high <= low:  # one value: the bar still needs a length
        high = low + max(abs(low), 1.0) * 1e-3
    return float(low), float(high)
