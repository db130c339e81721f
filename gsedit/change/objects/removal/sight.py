"""Views of a scene with an object and without it: what they show and what they hide.

`n` Gaussians; maps of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsedit.change.objects.removal.cells import closed, widened
from gsedit.scene.planes import DEEPER
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.render import render
from rasterizer.scene import Gaussians

OUTLINE = 0.1
"""Share of a pixel that the object gives, from which it is within the object's outline."""
HALO = 0.03
"""Width that outlines are widened by, of the object's size in the picture: selections miss a rim.
"""
RING = 0.2
"""Width of the surroundings of an outline, of the object's size in the picture."""
SAME_DEPTH = 0.03
"""Share of its depth within which two surfaces are one."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera, and the object in its picture."""

    camera: Camera
    depth: Float[np.ndarray, "h w"]
    """Along the view, world units, with the object; infinite where nothing is."""
    outline: Bool[np.ndarray, "h w"]
    """Pixels that the object has a part in, and a rim around them."""
    ring: Bool[np.ndarray, "h w"]
    """Pixels around the outline."""


@torch.no_grad()
def look(
    scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera]
) -> tuple[list[Sight], Float[Tensor, " n"]]:
    """The cameras that see the object, and what each Gaussian contributes to them all, pixels."""
    colors = inside.to(scene.means)[:, None].expand(-1, 3).contiguous()
    seen, sights = scene.means.new_zeros(len(scene)), []
    for camera in cameras:
        weights = color_weights(scene, camera)
        shown = weights.picture(colors)[..., 0].numpy() > OUTLINE
        if not shown.any():
            continue
        ones = torch.ones(camera.height, camera.width, 3)
        seen += weights.back(ones.to(scene.means))[:, 0]
        size = float(np.sqrt(shown.sum()))
        outline = widened(shown, max(1, round(HALO * size)))
        ring = widened(outline, max(2, round(RING * size))) & ~outline
        sights.append(Sight(camera, _depth(scene, camera)[0], outline, ring))
    return sights, seen


@torch.no_grad()
def contributions_of(scene: Gaussians, sights: Sequence[Sight]) -> Float[Tensor, "3 n"]:
    """Pixels that each Gaussian of a scene without the object gives: to all views, to the object's
    outlines, and to the rings around them."""
    sums = scene.means.new_zeros(len(scene), 3)
    for sight in sights:
        maps = np.stack((np.ones_like(sight.outline), sight.outline, sight.ring), -1)
        weights = color_weights(scene, sight.camera)
        sums += weights.back(torch.from_numpy(maps).to(scene.means))
    return sums.T


@dataclass(frozen=True, eq=False)
class Views:
    """The views that show the object, and what they show without it."""

    sights: Sequence[Sight]
    depth: Sequence[Float[np.ndarray, "h w"]]
    """Along the view, world units; infinite where nothing is."""
    alpha: Sequence[Float[np.ndarray, "h w"]]


def look_again(scene: Gaussians, sights: Sequence[Sight]) -> Views:
    """The views of what is left of a scene."""
    maps = [_depth(scene, sight.camera) for sight in sights]
    return Views(sights, [depth for depth, _ in maps], [alpha for _, alpha in maps])


def guessed(bare: Views, after: Views) -> float:
    """Share of the object's outlines in which its hole was filled: the depth is another there."""
    changed, total = 0, 0
    for sight, before, now in zip(bare.sights, bare.depth, after.depth):
        here, there = now[sight.outline], before[sight.outline]
        changed += int((np.isfinite(here) & (there > (1 + SAME_DEPTH) * here)).sum())
        total += here.size
    return changed / max(total, 1)


@torch.no_grad()
def _depth(
    scene: Gaussians, camera: Camera
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Median depth, infinite where nothing is, and the opacity."""
    shown = render(replace(scene, sh=scene.sh[:, :1]), camera, median_depth=True)
    depth = shown.median_depth
    assert depth is not None
    return depth.masked_fill(depth <= 0, torch.inf).numpy(), shown.alpha.numpy()


def _pixels_of(
    points: Float64[np.ndarray, "m 3"], sight: Sight
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Row, column and depth of points in a picture, and whether they are within it."""
    xy, z = (t.numpy() for t in sight.camera.project(torch.from_numpy(points)))
    column, row = np.floor(xy.clip(-1e6, 1e6)).astype(np.int64).T
    h, w = sight.depth.shape
    shown = (z > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
    return row.clip(0, h - 1), column.clip(0, w - 1), z, shown


def _under(
    depth: Float[np.ndarray, "h w"], pixels: tuple[np.ndarray, ...], height: float
) -> Float64[np.ndarray, " m"]:
    """How far under a plane that a camera is over by `height` the surface of pixels lies."""
    row, column, z, shown = pixels
    return np.where(shown, (depth[row, column] / np.where(shown, z, 1.0) - 1) * height, -np.inf)


def testify(
    points: Float64[np.ndarray, "m 3"],
    heights: Float64[np.ndarray, " v"],
    views: Views,
    tolerance: float,
) -> tuple[Float64[np.ndarray, " m"], ...]:
    """How many views say what of points of a plane: those that have it in the object's outline with
    nothing left before it, that saw through it to what is behind, that have nothing before it, and
    that it is covered in by what is left.

    `heights` are the cameras' over the plane. Surfaces are told apart that lie farther than
    `tolerance` from the plane.
    """
    revealed, through, unhidden, covered = (np.zeros(len(points)) for _ in range(4))
    for sight, height, rest in zip(views.sights, heights, views.depth):
        if height <= tolerance:
            continue
        pixels = row, column, _, shown = _pixels_of(points, sight)
        outlined = sight.outline[row, column] & shown
        under, under_left = (_under(depth, pixels, height) for depth in (sight.depth, rest))
        open_ = shown & (under_left > -tolerance)
        revealed += outlined & open_
        covered += shown & ~open_
        unhidden += shown & ~outlined & (under > -tolerance)
        through += shown & ~outlined & (under > DEEPER * tolerance)
    return revealed, through, unhidden, covered


def beside_image(
    points: Float64[np.ndarray, "m 3"],
    image: Float64[np.ndarray, "k 3"],
    sight: Sight,
    height: float,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, " m"]]:
    """Row and column of points of a plane, and whether a view shows them beside the object and its
    mirror `image`, points (see `testify`)."""
    row, column, _, within = _pixels_of(image, sight)
    shown = np.zeros_like(sight.outline)
    shown[row[within], column[within]] = True
    rim = max(1, round(HALO * np.sqrt(sight.outline.sum())))
    outline = sight.outline | widened(closed(shown, 2), rim)
    pixels = row, column, _, free = _pixels_of(points, sight)
    free = free & ~outline[row, column] & (_under(sight.depth, pixels, height) > -tolerance)
    return row, column, free & (height > tolerance)
