"""A plane as a picture: what lies on it, seen straight from above.

`n` Gaussians; a picture of `h w` cells; `k` harmonics a channel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int64

from gsedit.objects.removal.walls import Plane
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.numerics import Execution
from rasterizer.scene import Gaussians

FAINT = 1e-3
"""Opacity below which a cell has no color."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A picture of a plane. Its hole is what has to be filled."""

    camera: Camera
    """Looks straight down, in parallel rays."""
    cell: float
    """Side of a cell, world units."""
    values: Float[np.ndarray, "h w k3"]
    """Harmonics of what lies on the plane; the first three are the color."""
    known: Bool[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]
    caster: Bool[np.ndarray, "h w"]
    """Cells that the object stood close over."""
    depth: float
    """Depth of the plane along the camera's view."""
    usual: Float64[np.ndarray, " k"]
    """Factors of the harmonics in the color, over SH_DC: means over the cameras."""

    def points(self) -> Float64[np.ndarray, "m 3"]:
        """Middles of all cells on the plane, in rows."""
        return cells_of(self.camera, self.depth)

    def at(self, points: Float[np.ndarray, "n 3"]) -> Int64[np.ndarray, " n"]:
        """Flat indices of the cells that points lie over or under; -1 beyond the picture."""
        xy, _ = self.camera.project(torch.from_numpy(points).double())
        column, row = xy.floor().long().unbind(-1)
        h, w = self.hole.shape
        within = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        return torch.where(within, row * w + column, -1).numpy()

    def holds(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points over or under the hole."""
        cell = self.at(points)
        return self.hole.reshape(-1)[cell] & (cell >= 0)


def cells_of(camera: Camera, depth: float) -> Float64[np.ndarray, "m 3"]:
    centers = camera.pixel_centers().reshape(-1, 2)
    return camera.unproject(centers, torch.full((len(centers),), depth).double()).numpy()


def above(
    plane: Plane, middle: Float64[np.ndarray, "3"], half: Float64[np.ndarray, "2"], cell: float
) -> Camera:
    """A camera straight above a rectangle of a plane, given by its middle and half its sides."""
    z = -plane.normal
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(z, x), z))
    pose = np.eye(4)
    pose[:3, :3] = rotation
    eye = middle + 2 * plane.band * plane.normal
    pose[:3, 3] = -rotation @ eye
    width, height = (max(4, int(np.ceil(2 * each / cell))) for each in half)
    return Camera(
        torch.from_numpy(pose), 1 / cell, 1 / cell, width / 2, height / 2, width, height, "ortho",
        near=0.0,
    )  # fmt: skip


def harmonics_on(
    layer: Gaussians, camera: Camera, execution: Execution
) -> tuple[Float[np.ndarray, "h w k3"], Float[np.ndarray, "h w"]]:
    """Harmonics blended as colors are, and the opacity."""
    if not len(layer):
        shape = (camera.height, camera.width)
        return np.zeros((*shape, layer.sh.shape[1] * 3)), np.zeros(shape)
    weights = color_weights(layer, camera, execution=execution)
    alpha = weights.picture(torch.ones(len(layer), 3).to(layer.means))[..., 0]
    bands = [weights.picture(layer.sh[:, k].contiguous()) for k in range(layer.sh.shape[1])]
    values = torch.cat(bands, -1) / alpha.clamp_min(1e-3)[..., None]
    return values.double().numpy(), alpha.double().numpy()
