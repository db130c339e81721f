"""Gloss of wet surfaces: the sky and surroundings mirrored, as spherical harmonics of degree 2.

`n` Gaussians, of which `m` are wet; `d` directions they are seen from; `k` coefficients.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.quaternions import even_directions
from gsedit.scenery.setting import Setting
from gsedit.scenery.water import puddles, wetness
from gsedit.surface.surroundings import find_surroundings, prefiltered, reflected
from gsedit.toolkit.grade import GAMMA
from rasterizer.harmonics import basis
from rasterizer.numerics import AUTO, Execution, sh_to_color
from rasterizer.scene import Gaussians

DEGREE = 2
"""Least degree of the result."""
VIEWS = 48
"""Even directions of the sphere; a Gaussian is seen from those on its outer side."""
ROUGH_WET, ROUGH_PUDDLE = 0.3, 0.1
"""Roughness of a wet surface, and of standing water."""
WATER = 0.02
"""Reflectance of water that is looked at straight."""
LEAST_WET = 0.15
"""Wetness below which nothing shines."""
RIDGE = 0.02
"""Weight of the coefficients' size against the fit: directions below the surface are not seen."""


def glossy(setting: Setting, after: Gaussians, execution: Execution = AUTO) -> Gaussians:
    """The scene with reflections on what is wet, of a studio where nothing is around; `after` has
    its colors, and may be dimmer."""
    surface, place = setting.found.surface, setting.found.place
    shown = (setting.found.seen > 0) * setting.found.trust
    wet = wetness(setting) * setting.sure * shown
    rows = (wet > LEAST_WET).nonzero().squeeze(-1)
    near = (surface.points - place.center).norm(dim=-1) < 0.4 * place.distance
    if not len(rows) or not bool(near.any()):
        return after
    maps = prefiltered(find_surroundings(setting.scene, near, place.up, execution)).double()
    dim = _dimming(setting.scene, after, rows)
    standing = puddles(setting)[rows]
    rough = torch.lerp(
        torch.full_like(standing, ROUGH_WET), standing.new_tensor(ROUGH_PUDDLE), standing
    )
    views = torch.from_numpy(even_directions(VIEWS)).double()
    views = views[views @ place.up > 0.0]
    normals = surface.normals[rows]
    base = sh_to_color(after.sh[rows, 0].double()).clamp(0, 1) ** GAMMA
    gain = []
    for view in views:
        cosine = (normals @ view).clamp_min(0)
        mirrored = 2 * cosine[:, None] * normals - view
        fresnel = (WATER + (1 - WATER) * (1 - cosine) ** 5) * (1 - rough) * wet[rows]
        fresnel = fresnel * (cosine > 0)
        light = reflected(maps, mirrored, rough) * dim
        gain.append((base + fresnel[:, None] * light) ** (1 / GAMMA) - base ** (1 / GAMMA))
    return added(after, rows, views, gain)


def _dimming(before: Gaussians, after: Gaussians, rows: Tensor) -> float:
    """Light that is left, of the surroundings as of the wet surfaces."""
    old, new = (
        sh_to_color(each.sh[rows, 0].double()).clamp(0, 1) ** GAMMA for each in (before, after)
    )
    return float((new.mean() / old.mean().clamp_min(1e-6)).clamp(0.05, 1.0) ** 0.5)


def added(
    scene: Gaussians,
    rows: Tensor,
    views: Float[Tensor, "d 3"],
    gains: Iterable[Float[Tensor, "m 3"]],
) -> Gaussians:
    """The scene with display colors added to rows of it, for each direction it is seen from."""
    degree = max(scene.degree, DEGREE)
    functions = basis(-views, DEGREE)
    square = functions.T @ functions + RIDGE * len(views) * torch.eye(functions.shape[1]).double()
    weights = torch.linalg.solve(square, functions.T)
    fitted = torch.zeros(len(rows), len(weights), 3).to(weights)
    for weight, gain in zip(weights.T, gains, strict=True):
        fitted += weight[:, None] * gain[:, None]
    sh = torch.zeros(len(scene), (degree + 1) ** 2, 3, dtype=scene.sh.dtype)
    sh[:, : scene.sh.shape[1]] = scene.sh.detach()
    sh[rows, : functions.shape[1]] += fitted.to(sh)
    return replace(scene, sh=sh)
