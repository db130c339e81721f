"""The palette of a picture for the colors of a scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError, UsageError
from gsedit.scene.table import SplatTable
from gsedit.select.rules import EVERYTHING, Selection
from gsedit.toolkit.color_maps import as_table
from gsedit.toolkit.color_transfer import color_transport, sliced_distance
from gsedit.toolkit.operation import Say, Whole
from gsedit.toolkit.recolor import recolored

PICTURE_SIZE = 256
"""Longer side that a picture is reduced to, pixels: its colors hardly change."""
SAMPLED = 1 << 17
"""Gaussians, evenly over the rows, from which the map is made."""


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
        sample = rows[:: -(-len(rows) // SAMPLED)]
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
