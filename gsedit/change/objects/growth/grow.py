"""Growth: new Gaussians on a scene that lie or grow on its surfaces. `n` Gaussians before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.light.present import Survey, survey
from gsedit.change.objects.growth.bodies import (
    Patch,
    buried,
    covered,
    hidden,
    in_colors_of,
    layer,
    leaves,
    thickness,
    tufts,
)
from gsedit.change.objects.growth.table import Growth, Site, growth_of
from gsedit.change.objects.placing.daylight import Sun, sun_of
from gsedit.change.objects.placing.stance import stance_of
from gsedit.change.scenery.setting import Setting
from gsedit.errors import UsageError
from gsedit.scene.outcome import NEW, Outcome, check_finite
from gsedit.scene.quantiles import ends
from gsedit.select.region import Region, coverage
from gsedit.views.dataset import evenly_spaced
from gsedit.views.orbit import perpendicular
from gsedit.views.relief import relief_of
from gsedit.views.shadows import WIDE
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, color_to_sh, ruled, sh_to_color
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

VIEWS, VIEW_PIXELS = 6, 128
"""Cameras that haze is measured from, and the longer side of their pictures."""
SEEN, SOLID = 0.5, 0.9
"""Least part of new Gaussians in a pixel that tells, and least opacity of them alone there."""
FEWEST = 20
"""Pixels below which nothing is told."""
LEAST, MOST = 0.95, 1.25
"""Range of the factor: beyond it, something stands before them that is no haze."""


def unveiled(grown: Gaussians, new: Gaussians, cameras: Sequence[Camera]) -> Gaussians:
    """New Gaussians, the last of a grown scene, in colors that show as they are through what is
    before them: a factor a channel, the mean over the cameras."""
    marks = torch.arange(len(grown)) >= len(grown) - len(new)
    shown, wanted, count = torch.zeros(3).double(), torch.zeros(3).double(), 0
    for i in evenly_spaced(len(cameras), VIEWS):
        camera = cameras[i].fitted(VIEW_PIXELS)
        whole = render(grown, camera).color
        share = coverage(Region(marks), grown, camera)
        alone = render(new, camera)
        told = (share > SEEN) & (alone.alpha > SOLID)
        color = (alone.color[told] / alone.alpha[told][:, None]).double()
        part = share[told][:, None] * color
        shown += part.sum(0)
        wanted += (color - (whole[told] - part)).sum(0)
        count += int(told.sum())
    if count < FEWEST:
        return new
    gain = (wanted / shown.clamp_min(1e-9)).clamp(LEAST, MOST)
    sh = new.sh.clone()
    sh[:, 0] = color_to_sh(sh_to_color(sh[:, 0].double()) * gain).to(sh)
    return replace(new, sh=sh)


MOST_NEW = 100_000
"""Gaussians that are added at most."""
MOST_PIXELS = 400_000
"""Pixels of a map of the surface at most."""
COARSER = 1.15
"""Factor of the pixel, beyond what the numbers say, where there would be too many."""
FAINT = 0.05
"""Opacity below which a Gaussian is no surface."""
HIGHEST = 0.25
"""Height over the highest camera, in the cameras' distance, above which nothing is covered: no
camera sees it from above."""
TAIL = 0.02
"""Share of the centers, on either side, that an extent leaves out."""
RIM = 2
"""Pixels at the end of a surface that nothing lies on."""
FINEST = 0.5
"""Least pixel, in the width of the Gaussians of a surface: finer ones show them, not it."""
SIDES = 0.3
"""Height of the four sides from which walls are looked at, against their distance."""


@torch.no_grad()
@ruled
def grow(
    scene: Gaussians,
    name: str,
    amount: float = 1.0,
    inside: Bool[Tensor, " n"] | None = None,
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
) -> Outcome:
    """The scene with snow, moss, dust, ice or leaves (GROWTHS) on the Gaussians inside.

    `amount` is a factor of the usual thickness, of leaves of their number. None is inside: all are.
    Rows of the scene keep their places; new ones, at most MOST_NEW, follow. Raises UsageError for
    an unknown name, an amount out of range, or where it lies nowhere.
    """
    growth = growth_of(name, amount)
    check_finite(scene)
    found = survey(scene, cameras, None)
    site = _site(scene, found, inside, cameras)
    patches = [] if site is None else _patches(scene, site, growth, amount)
    new = _made(scene, patches, growth, amount)
    if not len(new):
        raise UsageError(
            f"{name} lies nowhere: nothing inside {growth.requirement}; choose more of it"
        )
    return _grown(scene, name, growth, patches, new, cameras)


def _grown(
    scene: Gaussians,
    name: str,
    growth: Growth,
    patches: list[Patch],
    new: Gaussians,
    cameras: Sequence[Camera],
) -> Outcome:
    """The scene with what grew on it, and what that hides in its color."""
    before, new = scene.detach(), new.with_degree(scene.degree)
    share = torch.zeros(len(scene), dtype=torch.float64)
    if growth.hides:
        for patch in patches:
            share = torch.maximum(share, buried(scene, patch, hidden(patch, growth)))
    grown = concatenate(in_colors_of(before, share, new), new)
    if growth.hides:
        cleared = unveiled(grown, new, cameras)
        grown = concatenate(in_colors_of(before, share, cleared), cleared)
    origin = torch.cat((torch.arange(len(scene)), torch.full((len(new),), NEW)))
    changed = torch.cat((share > 0, torch.ones(len(new), dtype=torch.bool)))
    note = f"{name}: {len(new):,} Gaussians were added to {len(scene):,}"
    return Outcome(grown, origin, changed, (note,))


def _made(scene: Gaussians, patches: list[Patch], growth: Growth, amount: float) -> Gaussians:
    """New Gaussians on all patches."""
    match growth.body:
        case "layer":
            made = [layer(patch, growth) for patch in patches]
        case "tufts":
            made = [tufts(patch, growth, amount) for patch in patches]
        case "leaves":
            made = [leaves(patch, growth, amount, MOST_NEW) for patch in patches]
    return concatenate(*made) if made else scene[:0]


def _site(
    scene: Gaussians, found: Survey, inside: Bool[Tensor, " n"] | None, cameras: Sequence[Camera]
) -> Site | None:
    """The opaque, small Gaussians inside that are near and not above all cameras; None if fewer
    than four are."""
    place, points = found.place, found.surface.points
    solid = (scene.opacities > FAINT) & (scene.scales.amax(-1) < WIDE * place.radius)
    solid &= found.trust > 0
    if inside is not None:
        solid &= inside
    if cameras:
        highest = max(float(camera.center.double() @ place.up) for camera in cameras)
        solid &= points @ place.up < highest + HIGHEST * place.distance
    rows = solid.nonzero().squeeze(-1)
    if len(rows) < 4:
        return None
    low, high = ends(points[rows], TAIL)
    size = min(float((high - low).norm()), place.distance)
    setting = Setting(scene, found, cameras)
    sun = _sun(scene, inside, place.up)
    return Site(setting, rows, max(size, 1e-9), sun)


def _sun(scene: Gaussians, inside: Bool[Tensor, " n"] | None, up: Float[Tensor, "3"]) -> Sun | None:
    """The sun that casts the shadows around what is inside; None where it is all, or none is
    clear."""
    if inside is None or bool(inside.all()):
        return None
    stance = stance_of(scene[inside], scene[~inside], up)
    return sun_of(scene, stance)


def _patches(scene: Gaussians, site: Site, growth: Growth, amount: float) -> list[Patch]:
    """Patches of a growth on the site; as fine as the number of Gaussians allows."""
    axes = _axes(site, growth)
    pixel = max(
        growth.grain * site.size,
        FINEST * float(scene.scales[site.rows].sort(-1).values[:, 1].median()),
    )
    points = site.setting.found.surface.points[site.rows]
    sides = (points.amax(0) - points.amin(0)).sort().values[1:]
    pixel = max(pixel, sqrt(float(sides.prod()) / MOST_PIXELS))
    while True:
        patches = [_patch(scene, site, growth, amount, pixel, axes, i) for i in range(len(axes))]
        patches = [patch for patch in patches if bool(patch.lies.any())]
        count = growth.each * sum(int(patch.lies.sum()) for patch in patches)
        if count <= MOST_NEW:
            return patches
        pixel *= COARSER * sqrt(count / MOST_NEW)


def _axes(site: Site, growth: Growth) -> Float[Tensor, "a 3"]:
    """Unit vectors along which the surface is looked at."""
    up = site.up
    if not growth.around:
        return up[None]
    first = perpendicular(up)
    second = torch.linalg.cross(up, first)
    level = torch.stack((first, second, -first, -second))
    return torch.nn.functional.normalize(torch.cat((up[None], level + SIDES * up)), dim=-1)


def _patch(
    scene: Gaussians,
    site: Site,
    growth: Growth,
    amount: float,
    pixel: float,
    axes: Float[Tensor, "a 3"],
    which: int,
) -> Patch:
    """The patch of a growth on what is seen along one of the axes, and faces that axis most."""
    relief = relief_of(scene[site.rows], axes[which], pixel).smoothed(growth.smooth)
    normals = relief.normals()
    own = (normals @ axes.T).argmax(-1) == which
    spots = site.spots(relief.points[relief.there], normals[relief.there])
    share = torch.zeros_like(relief.heights)
    share[relief.there] = growth.where(spots)
    share = share * own * relief.inner(RIM)
    lies = covered(relief, share, growth.edge)
    most = amount * growth.thickness * site.size
    return Patch(site, relief, lies, thickness(relief, lies, most), share)
