"""Growth: new Gaussians that lie or grow on surfaces of a scene: layers with round edges, tufts,
fallen leaves; and the color of what lies under them.

Gaussians are blended in the order of their centers, and reach farther than a layer is thick: in
their old color, those under it would be seen through it. `h w` pixels of a relief, `m` new
Gaussians, `n` old ones; world units, float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import ceil, sqrt, tau

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.change.light.relight import Survey, step, survey
from gsedit.change.objects.growth.places import Growth, Site, Spots, growth_of
from gsedit.change.objects.placing.daylight import sun_of
from gsedit.change.objects.placing.stance import stance_of
from gsedit.change.scenery.effects import AUTUMN, Setting, in_scenery
from gsedit.errors import UsageError
from gsedit.scene.framing import ends
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.outcome import NEW, Outcome, check_finite
from gsedit.scene.quaternions import quaternions_of
from gsedit.select.region import Region, coverage
from gsedit.views.dataset import evenly_spaced
from gsedit.views.orbit import perpendicular
from gsedit.views.place import Place
from gsedit.views.relief import Relief, relief_of, without_specks
from gsedit.views.shadows import WIDE
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.project import rotation_matrices
from rasterizer.render import backproject, render
from rasterizer.scene import Gaussians, concatenate

ROUND = 1.0
"""Width of the round edge, and of half a gap that a layer bridges, in the thickness."""
SPREAD, FLAT = 0.72, 0.16
"""Standard deviations along and across a surface, in pixels: neighbors blend to an even one."""
STEEPEST = 0.5
"""Cosine below which a disc is not stretched any more."""
MOST_OPAQUE = 0.985


@dataclass(frozen=True, eq=False)
class Patch:
    """A layer that lies on a relief."""

    site: Site
    relief: Relief
    """The surface under it, smooth."""
    lies: Bool[Tensor, "h w"]
    height: Float[Tensor, "h w"]
    """Thickness over the surface; 0 where it does not lie."""
    share: Float[Tensor, "h w"]
    """How much of each pixel it covers, in [0, 1]."""

    @property
    def top(self) -> Relief:
        """The layer's own surface."""
        top = self.relief.at(self.relief.heights + self.height)
        return replace(top, there=self.lies)

    def count(self, growth: Growth) -> int:
        """Number of discs or tufts on it."""
        if growth.body != "layer":
            return int(self.lies.sum())
        return sum(len(rows) for _, rows, _ in blocks_of(self.lies, self.top.normals()))

    def spots(self, surface: Relief) -> Spots:
        """Places of the layer, one a pixel, on its top or on the relief under it."""
        normals = surface.normals()[self.lies]
        return self.site.spots(surface.points[self.lies], normals)


def covered(relief: Relief, share: Float[Tensor, "h w"], least: float) -> Bool[Tensor, "h w"]:
    """Pixels that a layer lies on: those that more than the least share covers, without specks,
    small holes, and floaters, which are small pieces high above what is beside them."""
    lies = without_specks((share > least) & relief.there & ~relief.brinks)
    return ~without_specks(~lies) & relief.there & ~relief.brinks


def firm(relief: Relief, place: Place) -> Bool[Tensor, "h w"]:
    """Pixels near the subject, and of wide pieces without many brinks, as the ground: what else is
    far is leaves and floaters."""
    near = (relief.points - place.center).norm(dim=-1) < NEAR * place.distance
    smooth = relief.there & ~relief.brinks
    torn = torch.nn.functional.avg_pool2d(relief.brinks.double()[None], 21, 1, 10)[0] > TORN
    return near | without_specks(smooth, BROAD * float(smooth.sum())) & ~torn


def blanket(heights: Float[Tensor, "h w"], wide: int, fall: float) -> Float[Tensor, "h w"]:
    """The highest surface under this one that is nowhere rounder than a pillow, which falls by
    `fall` within `wide` pixels: edges get round, and what is narrower goes (an opening by a
    parabola, which is separable)."""
    drop = fall * (torch.arange(-wide, wide + 1).double() / wide).square()
    return -_sunk(-_sunk(heights, drop), drop)


def _sunk(heights: Float[Tensor, "h w"], drop: Float[Tensor, " k"]) -> Float[Tensor, "h w"]:
    """The lowest of the heights around, each lifted by its drop along rows and along columns."""
    wide = len(drop) // 2
    for axis in (0, 1):
        padded = torch.nn.functional.pad(heights.movedim(axis, -1)[None], (wide, wide), "replicate")
        count = heights.shape[axis]
        lifted = (padded[0, :, i : i + count] + rise for i, rise in enumerate(drop.tolist()))
        heights = reduce(torch.minimum, lifted).movedim(-1, axis)
    return heights


def discs(
    points: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    axis: Float[Tensor, "3"],
    pixel: float,
    opacity: Float[Tensor, " m"] | float,
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Flat Gaussians along a surface that is sampled once a pixel along an axis, stretched where
    it is steep; display colors."""
    cosine = (normals @ axis).clamp_min(STEEPEST)
    downhill = axis - (normals @ axis)[:, None] * normals
    along = torch.where(
        downhill.norm(dim=-1, keepdim=True) < 1e-3, perpendicular(normals), downhill
    )
    wide = torch.full_like(cosine, SPREAD)
    scales = torch.stack((wide / cosine, wide, torch.full_like(cosine, FLAT)), -1)
    return assembled(points, along, normals, pixel * scales, opacity, colors)


def assembled(
    points: Float[Tensor, "m 3"],
    along: Float[Tensor, "m 3"],
    normals: Float[Tensor, "m 3"],
    scales: Float[Tensor, "m 3"],
    opacity: Float[Tensor, " m"] | float,
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Gaussians of SH degree 0 with their last axis along unit normals and their first as near to
    another vector as that leaves; float32."""
    first = along - (along * normals).sum(-1, keepdim=True) * normals
    first = torch.nn.functional.normalize(first, dim=-1)
    frames = torch.stack((first, torch.linalg.cross(normals, first), normals), -1)
    opacities = torch.as_tensor(opacity, dtype=torch.float64).expand(len(points))
    found = Gaussians(
        points, torch.from_numpy(quaternions_of(frames.numpy())), scales.clamp_min(1e-12).log(),
        torch.logit(opacities.clamp(1e-4, MOST_OPAQUE)), color_to_sh(colors)[:, None],
    )  # fmt: skip
    return found.to(torch.float32)


BLOCKS, PLANE = (4, 2, 1), 0.998
"""Sides of squares of pixels that may be one disc, and the least length of the mean of unit normals
in them."""
HIDING = 0.4
"""Share of the usual thickness at which a layer hides what is under it."""
TUFT_TILT, TUFT_LONG, TUFT_WIDE = 0.45, 0.5, 0.4
"""Standard deviation of the tilt of a tuft against its normal; its length in the layer's thickness
and its width in pixels, as standard deviations."""
TUFT_UP = 0.35
"""Share of up in the direction of a tuft on a wall."""
LEAF = (
    # along, across, length, width, brightness: standard deviations, in leaf lengths
    (-0.42, 0.0, 0.10, 0.014, 0.5), (-0.24, 0.0, 0.07, 0.10, 0.86), (-0.1, 0.08, 0.09, 0.08, 1.0),
    (-0.1, -0.08, 0.09, 0.08, 0.94), (0.08, 0.07, 0.09, 0.075, 1.06), (0.08, -0.07, 0.09, 0.075, 1),
    (0.24, 0.0, 0.08, 0.075, 1.04), (0.38, 0.0, 0.065, 0.03, 1.1), (0.06, 0.0, 0.2, 0.009, 0.68),
)  # fmt: skip
"""Gaussians of a leaf: the stem, the blade and its vein."""
LEAF_AREA = 0.22
"""Area of a leaf, in squares of its length."""
LITTER = 0.45
"""Area of the leaves against that of the ground, for the usual amount."""
LEAF_TILT, LEAF_PILE = 0.22, 0.3
"""Standard deviation of a leaf's tilt, and how high leaves lie on each other, in their length."""


def layer(patch: Patch, growth: Growth) -> Gaussians:
    """A sheet of discs on top of a patch: one a block, see `blocks_of`."""
    top = patch.top
    normals, full = top.normals(), patch.share if growth.opacity < 0.9 else patch.lies.double()
    made = []
    for side, rows, columns in blocks_of(patch.lies, normals):
        at = [(rows + i, columns + j) for i in range(side) for j in range(side)]
        points, ways, share = (
            torch.stack([values[each] for each in at]).mean(0)
            for values in (top.points, normals, full)
        )
        spots = patch.site.spots(points, torch.nn.functional.normalize(ways, dim=-1))
        colors = colors_of(spots, growth)
        pixel = side * top.pixel
        made.append(discs(points, spots.normals, top.axis, pixel, growth.opacity * share, colors))
    return concatenate(*made)


def blocks_of(
    lies: Bool[Tensor, "h w"], normals: Float[Tensor, "h w 3"]
) -> list[tuple[int, Int[Tensor, " k"], Int[Tensor, " k"]]]:
    """Squares of pixels that lie on one plane, the largest first: their side, first rows and
    columns. A layer over a lawn would else take most of its discs."""
    free, found = lies.clone(), []
    for side in BLOCKS:
        h, w = (each // side for each in lies.shape)

        planes = torch.cat((free[..., None].to(normals), normals), -1)[: h * side, : w * side]
        means = planes.reshape(h, side, w, side, 4).mean((1, 3))
        flat = (means[..., 0] > 0.999) & (means[..., 1:].norm(dim=-1) > PLANE)
        rows, columns = (side * each for each in flat.nonzero().unbind(-1))
        found.append((side, rows, columns))
        taken = flat.repeat_interleave(side, 0).repeat_interleave(side, 1)
        free[: h * side, : w * side] &= ~taken
    return found


def colors_of(spots: Spots, growth: Growth) -> Float[Tensor, "m 3"]:
    """Display colors in the present light, mottled."""
    random = torch.randn(len(spots), generator=torch.Generator().manual_seed(0)).double()
    level = spots.rise.abs()  # discs are long where it is steep: mottles would be streaks
    mottle = 1 + growth.mottle * level * random.clamp(-2, 2)
    warm = torch.tensor((0.9, 0.5, 0.1)).double()  # what is brighter for some way is drier, too
    patches = growth.mottle * spots.noise(0.05, 7)[:, None] * warm
    return spots.shaded(growth.shade, growth.lit, spots.light()) * (mottle[:, None] + patches)


def tufts(patch: Patch, growth: Growth, amount: float) -> Gaussians:
    """A mat of discs, and short tufts that stand out of it, some lighter than others."""
    relief, spots = patch.top, patch.spots(patch.top)
    hollow = step(spots.openness, 0.1, 0.8) * spots.mean(patch.site.setting.detail(1.0))
    colors = colors_of(spots, growth) * (0.4 + 0.7 * hollow)[:, None]
    thin = growth.opacity * (2 * patch.share[patch.lies]).clamp_max(1)
    mat = discs(spots.points, spots.normals, relief.axis, relief.pixel, thin, 0.72 * colors)
    generator = torch.Generator().manual_seed(1)
    count = len(spots)
    tilt = TUFT_TILT * torch.randn(count, 3, generator=generator).double()
    ways = torch.nn.functional.normalize(spots.normals + TUFT_UP * patch.site.up + tilt, dim=-1)
    most = amount * growth.thickness * patch.site.size
    long = most * TUFT_LONG * (0.4 + torch.rand(count, generator=generator).double())
    shift = (torch.rand(count, 3, generator=generator).double() - 0.5) * relief.pixel
    points = spots.points + shift + 0.6 * long[:, None] * ways
    wide = torch.full_like(long, TUFT_WIDE * relief.pixel)
    bright = 0.85 + 0.5 * torch.rand(count, generator=generator).double()
    standing = assembled(
        points, ways, perpendicular(ways), torch.stack((long / 1.5, wide, wide), -1), 0.8,
        colors * bright[:, None],
    )  # fmt: skip
    return concatenate(mat, standing)


def leaves(patch: Patch, growth: Growth, amount: float, most: int) -> Gaussians:
    """Single leaves, of LEAF Gaussians each, strewn over a patch; at most `most` Gaussians."""
    random = np.random.default_rng(0)
    length = growth.thickness * patch.site.size
    density = patch.share[patch.lies].numpy()
    area = float(density.sum()) * patch.relief.pixel**2
    count = min(ceil(amount * LITTER * area / (LEAF_AREA * length**2)), most // len(LEAF))
    rows = torch.from_numpy(random.choice(len(density), count, p=density / density.sum()))
    ground = patch.spots(patch.relief)[rows]
    shift = torch.from_numpy(random.uniform(-0.5, 0.5, (count, 2)))
    tilt = LEAF_TILT * torch.from_numpy(random.normal(size=(count, 3)))
    plane = torch.stack((patch.relief.right, patch.relief.down))
    points = ground.points + patch.relief.pixel * (shift @ plane)
    normals = torch.nn.functional.normalize(ground.normals + tilt, dim=-1)
    turn = torch.from_numpy(random.uniform(0, tau, count))[:, None]
    first = perpendicular(normals)
    second = torch.linalg.cross(normals, first)
    along = turn.cos() * first + turn.sin() * second
    sizes = length * torch.from_numpy(random.uniform(0.65, 1.2, count))
    lift = length * torch.from_numpy(random.uniform(0.06, LEAF_PILE, count))
    which = torch.from_numpy(random.integers(len(AUTUMN), size=count))
    palette = torch.tensor(AUTUMN).double()[which]
    mottle = torch.from_numpy(1 + growth.mottle * random.normal(size=(count, 1)))
    light = ground.shaded(growth.shade, growth.lit, ground.light())
    return _leaf_shapes(
        points + lift[:, None] * normals, along, normals, sizes, palette * mottle * light
    )


def _leaf_shapes(
    points: Float[Tensor, "c 3"],
    along: Float[Tensor, "c 3"],
    normals: Float[Tensor, "c 3"],
    sizes: Float[Tensor, " c"],
    colors: Float[Tensor, "c 3"],
) -> Gaussians:
    """The LEAF Gaussians of each of `c` leaves, the tips curled up."""
    shape = torch.tensor(LEAF).double()
    across = torch.linalg.cross(normals, along)
    curl = 0.5 * shape[:, 0].square() + 1.5 * shape[:, 1].square() + 0.01 * (shape[:, 3] < 0.02)
    offsets = torch.stack((shape[:, 0], shape[:, 1], curl), -1)
    frames = torch.stack((along, across, normals), 1)
    at = points[:, None] + sizes[:, None, None] * (offsets @ frames)
    thin = torch.full_like(shape[:, 2], 0.008)
    scales = sizes[:, None, None] * torch.stack((shape[:, 2], shape[:, 3], thin), -1)
    shown = colors[:, None] * shape[:, 4][:, None]
    each = len(LEAF)
    return assembled(
        at.reshape(-1, 3), along.repeat_interleave(each, 0), normals.repeat_interleave(each, 0),
        scales.reshape(-1, 3), 0.97, shown.reshape(-1, 3),
    )  # fmt: skip


SEEN = (0.03, 0.2)
"""Share of a Gaussian that is seen along the axis from which it begins to be of the surface, and
is."""
HIDDEN = (0.3, 0.8)
"""Share of what is seen of it that is hidden from which it begins to take a color, and has it."""
LEVEL = 0.8
"""Least cosine to the axis of a surface that a layer buries what stands on: grass, gravel."""
NEAREST = 4
"""New Gaussians whose mean color one takes."""


def buried(scene: Gaussians, patch: Patch, hidden: Float[Tensor, "h w"]) -> Float[Tensor, " n"]:
    """Share, in [0, 1], that a layer covers of each Gaussian, from what it hides of each pixel."""
    relief, rows = patch.relief, patch.site.rows
    part = scene[rows]
    maps = torch.stack((hidden, torch.ones_like(hidden), torch.zeros_like(hidden)), -1)
    covered, seen, _ = backproject(part, relief.camera, maps).double().T
    mean = covered / seen.clamp_min(1e-9)
    share = torch.zeros(len(scene), dtype=torch.float64)
    share[rows] = step(seen / _area(part, relief), *SEEN) * step(mean, *HIDDEN)
    xy, _ = relief.camera.project(part.means.double())
    h, w = relief.there.shape
    at = tuple(xy[:, i].long().clamp(0, n - 1) for i, n in ((1, h), (0, w)))
    over = part.means.double() @ relief.axis - relief.heights[at]
    level = relief.normals()[at] @ relief.axis > LEVEL
    within = level & (over > -relief.pixel / 4) & (over < patch.height[at])
    share[rows] = torch.maximum(share[rows], within * hidden[at])
    return share


def _area(part: Gaussians, relief: Relief) -> Float[Tensor, " k"]:
    """Sum of each Gaussian's opacity over the pixels, with nothing before it; at least one's."""
    plane = torch.stack((relief.right, relief.down)) / relief.pixel
    axes = plane @ rotation_matrices(part.quats.double()) * part.scales.double()[:, None]
    spread = torch.linalg.det(axes @ axes.mT).clamp_min(0).sqrt()
    return tau * part.opacities.double() * spread.clamp_min(1 / tau)


def in_colors_of(scene: Gaussians, share: Float[Tensor, " n"], new: Gaussians) -> Gaussians:
    """The scene with a share of each Gaussian in the color of the new ones nearest to it; both have
    SH of one degree."""
    rows = (share > 0).nonzero().squeeze(-1)
    if not len(rows) or not len(new):
        return scene
    nearest = min(NEAREST, len(new))
    near = k_nearest(new.means.numpy(), scene.means[rows].detach().numpy(), nearest)[1]
    color = new.sh[torch.from_numpy(near)].mean(1)
    sh = scene.sh.detach().clone()
    mixed = share[rows][:, None, None].to(sh)
    sh[rows] = sh[rows] * (1 - mixed) + mixed * color
    return replace(scene, sh=sh)


VIEWS, VIEW_PIXELS = 6, 128
"""Cameras that haze is measured from, and the longer side of their pictures."""
SHOWN, SOLID = 0.5, 0.9
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
        told = (share > SHOWN) & (alone.alpha > SOLID)
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
NEAR, BROAD, TORN = 0.6, 0.2, 0.08
"""Distance from the subject, in the cameras', within which anything is covered from above; beyond
it, the least share of a piece in the surface, and the share of brinks of what is torn."""
FEWEST_ROWS = 4
"""Gaussians below which there is no surface."""
SHOWN_GRAIN = 1.5
"""Factor of the pixel for one picture."""
COARSER = 1.15
"""Factor of the pixel, beyond what the numbers say, where there would be too many."""
FAINT = 0.05
"""Opacity below which a Gaussian is no surface."""
HIGHEST = 0.25
"""Height over the highest camera, in the cameras' distance, above which nothing is covered: no
camera sees it from above."""
TAIL = 0.02
"""Share of the centers, on either side, that an extent leaves out."""
HOLES = 8
"""Pixels of half a hole in a surface that is closed."""
SLUMP, PITS = (8, 4), 2
"""Pixels around, of which most close a bare spot, and fewer for growths on walls; of half a pit."""
THINNER = (1.0, 0.5, 0.25)
"""Thicknesses that are tried: on what is narrow, as a tail, a layer is as thin as it is wide."""
LEAST_HEIGHT = 0.05
"""Least height of a layer, in its thickness."""
FINEST = 0.5
"""Least pixel, in the width of the Gaussians of a surface: finer ones show them, not it."""
SIDES = 0.3
"""Height of the four sides from which walls are looked at, against their distance."""


@torch.no_grad()
def grow(
    scene: Gaussians,
    name: str,
    amount: float = 1.0,
    inside: Bool[Tensor, " n"] | None = None,
    cameras: Sequence[Camera] = (),
    shown: Bool[Tensor, " n"] | None = None,
) -> Outcome:
    """The scene with snow, moss, dust, ice or leaves (GROWTHS) on the Gaussians inside.

    `amount` is a factor of the usual thickness, of leaves of their number. None is inside: all are.
    With what is `shown` in one picture it lies there alone, as fine as that needs.
    Rows of the scene keep their places; new ones, at most MOST_NEW, follow. Raises UsageError for
    an unknown name, an amount out of range, or where it lies nowhere.
    """
    growth = growth_of(name, amount)
    check_finite(scene)
    found = survey(scene, cameras, None)
    site = _site(scene, found, inside, cameras)
    if site is not None and shown is not None:
        growth = replace(growth, grain=SHOWN_GRAIN * growth.grain)
        rows = site.rows[shown[site.rows]]
        site = replace(site, rows=rows) if len(rows) >= FEWEST_ROWS else None
    patches = [] if site is None else _patches(scene, site, growth, amount)
    new = _made(scene, patches, growth, amount)
    if not len(new):
        raise UsageError(
            f"{name} lies nowhere: nothing inside {growth.requirement}; choose more of it"
        )
    weather = growth.weather if inside is None else None
    around = in_scenery(scene, weather, cameras) if weather else scene
    return _grown(scene, name, growth, patches, new, cameras, around)


def _grown(
    scene: Gaussians,
    name: str,
    growth: Growth,
    patches: list[Patch],
    new: Gaussians,
    cameras: Sequence[Camera],
    around: Gaussians,
) -> Outcome:
    """The scene, which looks as the one `around`, with what grew on it, and what that hides in its
    color."""
    before, new = around.detach(), new.with_degree(scene.degree)
    share = torch.zeros(len(scene), dtype=torch.float64)
    if growth.hides:
        for patch in patches:
            part = patch.height / (HIDING * growth.thickness * patch.site.size)
            over = growth.opacity * patch.share * part.clamp(0, 1)
            share = torch.maximum(share, buried(scene, patch, over))
        new = unveiled(concatenate(in_colors_of(before, share, new), new), new, cameras)
    grown = concatenate(in_colors_of(before, share, new), new)
    origin = torch.cat((torch.arange(len(scene)), torch.full((len(new),), NEW)))
    changed = torch.ones(len(grown), dtype=torch.bool)
    if around is scene:
        changed[: len(scene)] = share > 0
    note = f"{name}: {len(new):,} Gaussians were added to {len(scene):,}"
    return Outcome(grown, origin, changed, (note,))


def _made(scene: Gaussians, patches: list[Patch], growth: Growth, amount: float) -> Gaussians:
    """New Gaussians on all patches."""
    kinds = {
        "layer": lambda patch: layer(patch, growth),
        "tufts": lambda patch: tufts(patch, growth, amount),
        "leaves": lambda patch: leaves(patch, growth, amount, MOST_NEW),
    }
    made = [kinds[growth.body](patch) for patch in patches]
    return concatenate(*made) if made else scene[:0]


def _site(
    scene: Gaussians, found: Survey, inside: Bool[Tensor, " n"] | None, cameras: Sequence[Camera]
) -> Site | None:
    """The opaque, small Gaussians inside that are near and not above all cameras; None if fewer
    than FEWEST_ROWS are."""
    place, points = found.place, found.surface.points
    solid = (scene.opacities > FAINT) & (scene.scales.amax(-1) < WIDE * place.radius)
    solid &= found.trust > 0
    if inside is not None:
        solid &= inside
    if cameras:
        highest = max(float(camera.center.double() @ place.up) for camera in cameras)
        solid &= points @ place.up < highest + HIGHEST * place.distance
    rows = solid.nonzero().squeeze(-1)
    if len(rows) < FEWEST_ROWS:
        return None
    low, high = ends(points[rows], TAIL)
    size = min(float((high - low).norm()), place.distance)
    setting = Setting(scene, found, cameras)
    sun = None
    if inside is not None and not bool(inside.all()):  # of the shadows around what is inside
        sun = sun_of(scene, stance_of(scene[inside], scene[~inside], place.up))
    return Site(setting, rows, max(size, 1e-9), sun, inside is None)


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
        count = sum(growth.each * patch.count(growth) for patch in patches)
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
    most = amount * growth.thickness * site.size
    wide = max(1, round(ROUND * most / pixel))
    seen = relief_of(scene[site.rows], axes[which], pixel).filled(PITS if growth.around else HOLES)
    lowest = seen.heights[seen.there].amin() if bool(seen.there.any()) else 0.0
    heights = torch.where(seen.there, seen.heights, lowest)
    if not growth.around:
        heights = -blanket(-heights, PITS, 0.0)
    bridged = -blanket(-heights, wide, most)
    bridged = torch.where(bridged - heights < most, bridged, heights)
    relief = seen.at(bridged).smoothed(growth.smooth)
    normals = relief.normals()
    own = (normals @ axes.T).argmax(-1) == which
    spots = site.spots(relief.points[relief.there], normals[relief.there])
    share = torch.zeros_like(relief.heights).masked_scatter(relief.there, growth.where(spots))
    reach = SLUMP[growth.around]
    around = torch.nn.functional.avg_pool2d(share[None], 2 * reach + 1, 1, reach)[0]
    share = torch.maximum(share, around) * own
    heights = torch.where(relief.there, relief.heights, lowest)
    tops = (
        blanket(heights + part * most * share, max(1, round(part * wide)), part * most)
        for part in THINNER
    )
    height = (reduce(torch.maximum, tops) - heights).clamp(0, most) * relief.there
    lies = covered(relief, share * (height > LEAST_HEIGHT * most), growth.edge)
    if site.whole and not growth.around:
        lies &= firm(relief, site.setting.found.place)
    return Patch(site, relief, lies, height * lies, share)
