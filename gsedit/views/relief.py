"""Surface of a scene or a part as it is seen along an axis: a map of heights, and its slopes.

`h w` pixels; world units, float64. Heights are along the axis, towards the eye.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.scene.framing import ends
from gsedit.views.orbit import parallel, perpendicular
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

STEP = 6.0
"""Difference of height, in pixels, between neighbors that are on two surfaces."""
MARGIN = 6
"""Pixels around the part."""
FEWEST = 24
"""Pixels of a piece of surface: smaller ones are floaters."""


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights of a surface seen along an axis, one a pixel."""

    camera: Camera
    """The eye, far away, with parallel rays."""
    points: Float[Tensor, "h w 3"]
    """Surface under the center of each pixel; its height counts where `there` is set."""
    there: Bool[Tensor, "h w"]
    """Whether there is a surface."""

    @property
    def axis(self) -> Float[Tensor, "3"]:
        """Unit vector from the surface to the eye."""
        return -self.camera.rotation[2].double()

    @property
    def right(self) -> Float[Tensor, "3"]:
        """World direction of the columns."""
        return self.camera.rotation[0].double()

    @property
    def down(self) -> Float[Tensor, "3"]:
        """World direction of the rows."""
        return self.camera.rotation[1].double()

    @property
    def pixel(self) -> float:
        """Side of a pixel."""
        return 1 / self.camera.fx

    @property
    def heights(self) -> Float[Tensor, "h w"]:
        return self.points @ self.axis

    @property
    def tops(self) -> Float[Tensor, "h w"]:
        """Heights, -inf where there is no surface."""
        return self.heights.masked_fill(~self.there, -torch.inf)

    def under(self, points: Float[Tensor, "m 3"]) -> Bool[Tensor, "h w"]:
        """Flag the pixels that points are over, and those next to them; points beyond the map are
        over its border."""
        xy, _ = self.camera.project(points.double())
        height, width = self.there.shape
        flags = torch.zeros(height, width)
        rows, columns = (xy[:, i].long().clamp(0, n - 1) for i, n in ((1, height), (0, width)))
        flags[rows, columns] = 1.0
        return torch.nn.functional.max_pool2d(flags[None], 3, stride=1, padding=1)[0] > 0

    def at(self, heights: Float[Tensor, "h w"]) -> Relief:
        """The map with other heights."""
        lifted = self.points + (heights - self.heights)[..., None] * self.axis
        return replace(self, points=lifted)

    def filled(self, reach: int) -> Relief:
        """The map without holes that are at most 2 `reach` pixels wide: they get the height of what
        is nearest. From above, the ground of a capture is full of holes between needles."""
        from scipy import ndimage

        there = self.there.numpy()
        closed = ndimage.binary_closing(np.pad(there, reach), np.ones((3, 3)), reach)
        found: Any = ndimage.distance_transform_edt(
            ~there, return_distances=False, return_indices=True
        )
        nearest = tuple(torch.from_numpy(each).long() for each in found)
        there = torch.from_numpy(closed[reach:-reach, reach:-reach].copy())
        return replace(self.at(self.heights[nearest]), there=there)

    def smoothed(self, rounds: int) -> Relief:
        """The map with means over neighbors on the same surface, one after the other."""
        heights = self.heights
        for _ in range(rounds):
            around, same = self._around(heights)
            heights = (around * same).sum(0) / same.sum(0).clamp_min(1)
        return self.at(heights)

    def normals(self) -> Float[Tensor, "h w 3"]:
        """Unit normals towards the eye, by differences to the neighbors on the same surface."""
        heights = self.heights
        around, same = self._around(heights)
        rises = (around - heights) * same

        def slope(ahead: int, behind: int) -> Float[Tensor, "h w"]:
            count = (same[ahead].double() + same[behind]).clamp_min(1)
            return (rises[ahead] - rises[behind]) / (count * self.pixel)

        across, along = slope(5, 3), slope(7, 1)
        tilted = self.axis - across[..., None] * self.right - along[..., None] * self.down
        return torch.nn.functional.normalize(tilted, dim=-1)

    @property
    def brinks(self) -> Bool[Tensor, "h w"]:
        """Pixels of the surface next to one of a lower surface, or to none."""
        lifted = (-self.tops)[None, None]
        lowest = -torch.nn.functional.max_pool2d(lifted, 3, 1, 1)[0, 0]
        return self.there & (self.tops - lowest > STEP * self.pixel)

    def _around(self, heights: Float[Tensor, "h w"]) -> tuple[Tensor, Tensor]:
        """Heights of the 3 x 3 pixels around each, row by row, and whether they are on its
        surface."""
        around = _neighbors(heights)
        same = self._beside & ((around - heights).abs() < STEP * self.pixel)
        return around, same

    @cached_property
    def _beside(self) -> Bool[Tensor, "9 h w"]:
        """Whether the 3 x 3 pixels around each one of the surface are of it."""
        return (_neighbors(self.there.double()) > 0) & self.there


def relief_of(part: Gaussians, axis: Float[Tensor, "3"], pixel: float) -> Relief:
    """The surface of a part that is seen along a unit vector; pieces of FEWEST pixels are left
    out."""
    across = perpendicular(axis)
    along = torch.linalg.cross(axis, across)
    frame = torch.stack((across, along, axis))
    # stray ones would widen the map
    low, high = ends(part.means.detach().double() @ frame.T, 0.002)
    center = ((low + high) / 2) @ frame
    reach = 4.0 * float((high - low).norm().clamp_min(pixel))  # rays are parallel: any would do
    height, width = (int(float(side) / pixel) + 2 * MARGIN for side in (high - low)[:2])
    camera = parallel(center, axis, across, pixel, (width, height), reach)
    plain = replace(part, sh=part.sh[:, :1]).detach()
    drawn = render(plain, camera, depth=True, median_depth=True)
    median, mean = drawn.median_depth, drawn.depth
    assert median is not None
    assert mean is not None
    # the mean has no steps between Gaussians, but is of two surfaces at silhouettes
    depth = torch.where((mean - median).abs() < STEP * pixel, mean, median)
    points = camera.unproject(camera.pixel_centers().double(), depth.double())
    return _cleaned(Relief(camera, points, depth > 0))


def without_specks(flags: Bool[Tensor, "h w"], fewest: float = FEWEST) -> Bool[Tensor, "h w"]:
    """The pixels that are set, but for connected pieces of fewer."""
    from scipy import ndimage

    found: Any = ndimage.label(flags.numpy())
    pieces = torch.from_numpy(found[0].astype(np.int64))
    sizes = torch.bincount(pieces.reshape(-1))
    return flags & (sizes >= fewest)[pieces]


def _cleaned(relief: Relief) -> Relief:
    """The map without specks of one pixel and without small pieces."""
    around = _neighbors(relief.heights)
    there = _neighbors(relief.there.double()) > 0
    middle = around.masked_fill(~there, torch.nan).nanmedian(0).values
    relief = relief.at(torch.where(relief.there, middle, relief.heights))
    return replace(relief, there=without_specks(relief.there))


def _neighbors(values: Float[Tensor, "h w"]) -> Float[Tensor, "9 h w"]:
    padded = torch.nn.functional.pad(values[None, None], (1, 1, 1, 1), "replicate")
    h, w = values.shape
    return torch.nn.functional.unfold(padded, 3)[0].reshape(9, h, w)
