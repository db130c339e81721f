"""Colors that depend on the view, as spherical harmonics of degree 2: gloss of what is wet, and
drawings, whose lines are where a surface turns away from the eye.

`n` Gaussians, of which `m` change; `d` directions they are seen from; `k` coefficients.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.relight import ColorChange, step
from gsedit.scene.quaternions import even_directions
from gsedit.scenery.setting import CLUMP, LEAF, Setting
from gsedit.surface.surroundings import find_surroundings, prefiltered, reflected
from gsedit.toolkit.grade import GAMMA
from rasterizer.harmonics import basis
from rasterizer.numerics import sh_to_color
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


def wetness(setting: Setting) -> Float[Tensor, " n"]:
    """How wet each Gaussian is, in [0, 1]: what faces up and is open above; sides in streaks."""
    flat = step(setting.rise, 0.15, 0.75)
    streaks = 0.55 * step(setting.noise(3 * LEAF, 21), -0.8, 0.8)
    open_above = step(setting.overhead, 0.1, 0.5)
    return torch.maximum(flat, streaks) * (0.25 + 0.75 * open_above) * (1 - setting.sky)


def puddles(setting: Setting) -> Float[Tensor, " n"]:
    """Share of standing water: in hollows of what is level."""
    level = step(setting.rise, 0.9, 0.97) * setting.sure
    return level * step(setting.noise(6 * LEAF, 22), 0.2, 0.7) * wetness(setting)


def glossy(setting: Setting, after: Gaussians) -> Gaussians:
    """The scene with reflections on what is wet, of a studio where nothing is around; `after` has
    its colors, and may be dimmer."""
    surface, place = setting.found.surface, setting.found.place
    shown = (setting.found.seen > 0) * setting.found.trust
    wet = wetness(setting) * setting.sure * shown
    rows = (wet > LEAST_WET).nonzero().squeeze(-1)
    near = (surface.points - place.center).norm(dim=-1) < 0.4 * place.distance
    if not len(rows) or not bool(near.any()):
        return after
    maps = prefiltered(find_surroundings(setting.scene, near, place.up, setting.execution)).double()
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


PAPER, GRAPHITE = (0.95, 0.94, 0.91), (0.16, 0.16, 0.18)
"""Display colors of paper and of lines."""
RIM = 4
"""Power of 1 less the cosine to the eye, with which a line at the rim of a surface fades."""
PALE, VIVID = 0.75, 1.6
"""Share of its darkness that a wash keeps, and the factor of its saturation."""


def sketch(setting: Setting) -> ColorChange:
    """Pencil on paper: shade in soft tones, lines where colors change."""
    shade = 0.42 * (1 - _spread(setting)) ** 1.5
    grain = 1 + 0.16 * setting.noise(LEAF / 3, 31)
    share = (shade * grain + 0.75 * _lines(setting)).clamp(0, 1)
    paper, graphite = (torch.tensor(each).double() for each in (PAPER, GRAPHITE))
    return _veil(torch.lerp(paper, graphite, share[:, None]))


def watercolor(setting: Setting) -> ColorChange:
    """Washes: colors flow together, are vivid and pale, and pool at their edges."""
    around = setting.found.surface.smoothed(setting.colors, 6)
    brightest = around.amax(-1, keepdim=True)
    gray = around.mean(-1, keepdim=True)
    pale = (1 - PALE * (1 - brightest)) / brightest.clamp_min(0.05)
    vivid = ((gray + VIVID * (around - gray)) * pale).clamp(0, 1)
    thin = 0.25 + 0.13 * setting.noise(CLUMP / 2, 33) + 0.06 * setting.noise(LEAF / 2, 34)
    paper = torch.tensor(PAPER).double()
    pooled = 1 - 0.45 * _lines(setting)
    wash = torch.lerp(vivid, paper.expand_as(vivid), thin.clamp(0, 0.8)[:, None])
    return _veil((wash * pooled[:, None]).clamp(0, 1))


def penciled(setting: Setting, after: Gaussians) -> Gaussians:
    """The drawn scene with pencil lines where it turns away from the eye."""
    surface = setting.found.surface
    views = torch.from_numpy(even_directions(VIEWS)).double()
    away = torch.tensor(GRAPHITE).double() - sh_to_color(after.sh[:, 0].double())
    sure = step(surface.confidence, 0.5, 0.9)
    rims = ((1 - (surface.normals @ view).clamp_min(0)) ** RIM for view in views)
    lines = ((sure * rim)[:, None] * away for rim in rims)
    return added(after, torch.arange(len(after)), views, lines)


def _spread(setting: Setting) -> Float[Tensor, " n"]:
    """Brightness from 0 for the darkest to 1 for the brightest parts of what is seen."""
    luma = setting.found.surface.smoothed(setting.luminance) ** (1 / GAMMA)
    weight = setting.found.seen
    order = luma.argsort()
    rank = weight[order].cumsum(0) / weight.sum().clamp_min(1e-12)
    low, high = (
        luma[order[int(torch.searchsorted(rank, share).clamp_max(len(luma) - 1))]]
        for share in (0.02, 0.98)
    )
    return ((luma - low) / (high - low).clamp_min(1e-6)).clamp(0, 1)


def _lines(setting: Setting) -> Float[Tensor, " n"]:
    """How surely each Gaussian is on a line, in [0, 1]: darker than what is around it."""
    surface = setting.found.surface
    near, far = surface.smoothed(setting.luminance, 1), surface.smoothed(setting.luminance, 6)
    ratio = (near + 0.005) / (far + 0.005)
    return step(ratio ** (1 / GAMMA), 0.97, 0.78)


def _veil(color: Float[Tensor, "n 3"]) -> ColorChange:
    """Other colors instead of the present ones."""
    return ColorChange(1.0, torch.ones_like(color), torch.ones(len(color)).double(), color)
