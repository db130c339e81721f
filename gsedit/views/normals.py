"""Outward normals of Gaussians: their shortest axes and the depth that cameras see.

A view blends the shortest axes, turned to its camera, and the slope of its depth; both are
projected back onto the Gaussians, summed over the views, and smoothed over neighbors in space.
World axes. `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.scene.neighbors import nearest
from gsedit.views.dataset import evenly_spaced
from gsedit.views.orbit import orbit
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC
from rasterizer.project import rotation_matrices
from rasterizer.render import backproject, render
from rasterizer.scene import Gaussians

VIEWS = 16
"""Most views that are looked at."""
VIEW_PIXELS = 192
"""Longer side of their pictures."""
DEPTH_SHARE = 2.0
"""Weight of the slope of depth against blended axes: it is noisy, and the axes of needles say
nothing."""
DEPTH_STEP = 2
"""Pixels on either side over which depth is compared: single pixels are noise."""
ABOVE = 30.0
"""Degrees above and below the horizon of the cameras around a scene that has none."""
FAINT = 1e-12
"""Length of a vector that has no direction."""
ROWS = 1 << 18
"""Gaussians whose axes are computed at once: rotation matrices are nine numbers each."""


@dataclass(frozen=True, eq=False)
class Normals:
    """Outward unit normals of Gaussians, and how sure they are."""

    directions: Float[Tensor, "n 3"]
    """Unit vectors in world axes, towards where the Gaussian was seen from."""
    confidence: Float[Tensor, " n"]
    """Agreement with the neighbors and over the views, in [0, 1]: 1 on a smooth surface, about 0.5
    in foliage, 0 where nothing says."""


@torch.no_grad()
def estimate_normals(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    inside: Bool[Tensor, " a"] | None = None,
    near: Int[Tensor, "n k"] | None = None,
) -> Normals:
    """The normals of all Gaussians, or of the `n` inside a part, from at most VIEWS cameras.

    `near` are the rows of each one's nearest among them, if they are known (`rows_near`). Without
    cameras, rings above and below are used. Gaussians that no camera sees take that of
    their neighbors, or their shortest axis, turned to the mean of the cameras.
    """
    if not len(scene):
        return Normals(scene.means, scene.means[:, 0])
    seen_from = list(cameras) or all_around(scene)
    chosen = [seen_from[i].fitted(VIEW_PIXELS) for i in evenly_spaced(len(seen_from), VIEWS)]
    axes = shortest_axes(scene)
    seen = torch.zeros_like(scene.means)
    for camera in chosen:
        seen += backproject(scene, camera, _view_normals(scene, axes, camera))
    middle = torch.stack([camera.center for camera in chosen]).mean(0).to(scene.means)
    means = scene.means
    if inside is not None:
        means, seen, axes = means[inside], seen[inside], axes[inside]
    lit = torch.where(seen.norm(dim=-1, keepdim=True) > FAINT, seen, middle - means)
    own = axes * _sign((axes * lit).sum(-1, keepdim=True))
    away = torch.nn.functional.normalize(means - middle, dim=-1)
    # what no view sees is left with its own axis
    evidence = seen + 0.25 * own - 10 * FAINT * away
    return smoothed(evidence, rows_near(means) if near is None else near)


def rows_near(means: Float[Tensor, "n 3"]) -> Int[Tensor, "n k"]:
    """The rows of the nearest neighbors of each place."""
    return torch.from_numpy(nearest(means.float().cpu().numpy())[1])


def neighbor_means(
    values: Float[Tensor, "n ..."], rows: Int[Tensor, "n k"], rounds: int
) -> Float[Tensor, "n ..."]:
    """Means of values over each point and its nearest, `rounds` times one after the other."""
    for _ in range(rounds):
        values = (values + values[rows].sum(1)) / (1 + rows.shape[1])
    return values


def visible_area(scene: Gaussians) -> Float[Tensor, " n"]:
    """Opacity times the area of the largest face, float64: how much of a picture each may fill."""
    area = scene.log_scales.double().sort(-1).values[:, 1:].sum(-1).exp()
    return scene.opacities.double() * area


def shortest_axes(scene: Gaussians) -> Float[Tensor, "n 3"]:
    """The shortest axes of either sign; their length is 1 - shortest / middle standard deviation,
    how flat a Gaussian is: a ball or a needle says nothing of a surface."""
    starts = range(0, max(len(scene), 1), ROWS)
    return torch.cat([_axes(scene[start : start + ROWS]) for start in starts])


def facing(axes: Float[Tensor, "n 3"], scene: Gaussians, camera: Camera) -> Float[Tensor, "n 3"]:
    """The axes, each turned to the camera."""
    if camera.model == "ortho":
        towards = -camera.forward.to(axes).expand_as(axes)
    else:
        towards = camera.center.to(axes) - scene.means
    return axes * _sign((axes * towards).sum(-1, keepdim=True))


def normals_of_depth(
    camera: Camera, depth: Float[Tensor, "h w"], step: int = DEPTH_STEP
) -> Float[Tensor, "h w 3"]:
    """Unit normals of a depth map, towards the camera; 0 at silhouettes, borders and where depth
    is 0. Differences are taken over `step` pixels on either side."""
    points = camera.unproject(camera.pixel_centers(), depth.double())
    normals = torch.zeros_like(points)
    if min(depth.shape) <= 2 * step:
        return normals.to(depth)
    middle, ahead, behind = slice(step, -step), slice(2 * step, None), slice(None, -2 * step)
    rows = (points[ahead, middle], points[behind, middle])
    columns = (points[middle, ahead], points[middle, behind])
    depths = torch.stack(
        [depth[middle, middle], depth[ahead, middle], depth[behind, middle],
         depth[middle, ahead], depth[middle, behind]]
    )  # fmt: skip
    low, high = depths.amin(0), depths.amax(0)
    smooth = (low > 0) & (high - low < 0.1 * low)  # else a border
    across = torch.linalg.cross(rows[0] - rows[1], columns[0] - columns[1])  # faces the camera
    normals[middle, middle] = torch.nn.functional.normalize(across, dim=-1) * smooth[..., None]
    return normals.to(depth)


def all_around(scene: Gaussians) -> list[Camera]:
    """Two rings of cameras, one above and one below the middle of a scene."""
    rings = (orbit(scene, VIEWS // 2, VIEW_PIXELS, elevation=each) for each in (ABOVE, -ABOVE))
    return [camera for ring in rings for camera in ring]


def _view_normals(
    scene: Gaussians, axes: Float[Tensor, "n 3"], camera: Camera
) -> Float[Tensor, "h w 3"]:
    """A view's blend of axes and slope of depth: longer where they agree."""
    towards = facing(axes, scene, camera)
    # as colors in [0, 1]: the blend of n / 2 + 1 / 2 is (the blend of n) / 2 + alpha / 2
    colored = replace(scene, sh=(towards / 2 / SH_DC)[:, None])
    drawn = render(colored, camera, median_depth=True)
    assert drawn.median_depth is not None
    blended = 2 * drawn.color - drawn.alpha[..., None]
    return blended + DEPTH_SHARE * normals_of_depth(camera, drawn.median_depth)


def smoothed(evidence: Float[Tensor, "n 3"], rows: Int[Tensor, "n k"], rounds: int = 2) -> Normals:
    """Unit normals, mixed with those of neighbors that face alike; and their agreement.

    Each counts by the logarithm of its evidence: one near a camera does not outweigh all others.
    """
    strength = evidence.norm(dim=-1)
    some = strength[strength > FAINT]
    typical = some.median() if len(some) else strength.new_ones(())
    weight = torch.log1p(strength / typical)[:, None]
    unit = evidence / strength.clamp_min(FAINT)[:, None]
    agreement = torch.ones_like(strength)
    for _ in range(rounds if rows.shape[1] else 0):
        near = unit[rows]
        # a power of the cosine: edges stay sharp
        alike = (near * unit[:, None]).sum(-1, keepdim=True).clamp(0, 1) ** 8
        total = weight * unit + (alike * weight[rows] * near).sum(1)
        length = total.norm(dim=-1, keepdim=True)
        all_alike = weight + weight[rows].sum(1)
        agreement = (length / all_alike.clamp_min(FAINT)).squeeze(-1)
        unit = torch.where(length > FAINT, total / length.clamp_min(FAINT), unit)
    return Normals(unit, agreement.clamp(0, 1))


def _axes(scene: Gaussians) -> Float[Tensor, "n 3"]:
    ordered, order = scene.log_scales.sort(-1)
    flatness = 1 - (ordered[:, 0] - ordered[:, 1]).exp()
    rotation = rotation_matrices(scene.quats)
    axes = rotation.gather(2, order[:, :1, None].expand(-1, 3, 1)).squeeze(-1)
    return axes * flatness[:, None].nan_to_num(0.0)


def _sign(values: Float[Tensor, "*s"]) -> Float[Tensor, "*s"]:
    """1 for values of at least 0, else -1."""
    return torch.where(values < 0, -1.0, 1.0)
