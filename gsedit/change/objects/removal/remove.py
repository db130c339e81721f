"""Remove an object and fill what nobody saw behind it.

Along go Gaussians that belong to it beyond what was selected: its rim and floaters, its mirror
image. What stood on it and hangs in the air is told.
`n` Gaussians before, or of what is left; `m` after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage
from torch import Tensor

from gsedit.change.objects.removal.cells import (
    closed,
    enclosing,
    parts_of,
    rectangle_around,
    widened,
)
from gsedit.change.objects.removal.fill import as_seen, backdrop, filled, find_gap
from gsedit.change.objects.removal.sheet import Object, Sheet, find_shade, find_sheet, standing
from gsedit.change.objects.removal.sight import (
    Sight,
    Views,
    contributions_of,
    guessed,
    look,
    look_again,
    testify,
)
from gsedit.errors import UsageError
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.neighbors import extent_of, k_nearest, linked
from gsedit.scene.outcome import NEW, Outcome, check_finite
from gsedit.scene.planes import SMALLEST, Plane, find_planes
from gsedit.select.layers import numbered
from gsedit.select.segment import segment_surfaces
from gsedit.select.subject import block_under
from gsedit.select.surfaces import Surfaces
from gsedit.select.surfaces import look as look_at_surfaces
from gsedit.views.around import cameras_of
from gsedit.views.dataset import evenly_spaced
from gsedit.views.normals import shortest_axes
from gsedit.views.paths import up_of
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians, concatenate

NEIGHBORS = 16
"""Nearest Gaussians that vote on one."""
FEW, MOST = 0.2, 0.8
"""Share of them inside, below which one is not, and above which it is."""
MARGIN = 0.1
"""Width around the object in which flags are looked at, of its extent."""
CORE = 0.035
"""Distance from all that is outside, of the extent, from which a Gaussian is surely inside."""
LEAST_CORE = 0.3
"""Least share of the object that is its core: else it is thin, and all of it is."""


def tidied(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The flags without single ones that are unlike their neighbors; at least one stays."""
    tidy, near = inside.copy(), _near(points, inside)
    for rows, among in ((near, near), (inside & ~near, np.ones_like(near))):
        at, of = np.flatnonzero(rows), np.flatnonzero(among)
        if len(at) and len(of) > NEIGHBORS:
            _, found = k_nearest(points[of], points[at], NEIGHBORS + 1)
            share = inside[of][found[:, 1:]].mean(1)
            tidy[at] = (share > MOST) | (inside[at] & (share >= FEW))
    return tidy if tidy.any() and not tidy.all() else inside


def core_of(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The Gaussians that are inside even if too much was selected; all, of a thin object."""
    near = _near(points, inside) & ~inside
    if not near.any():
        return inside
    width = CORE * extent_of(points[inside])
    away = k_nearest(points[near], points[inside], 1, width)[0][:, 0]
    core = np.zeros_like(inside)
    core[np.flatnonzero(inside)[np.isinf(away)]] = True
    return core if core.sum() > LEAST_CORE * inside.sum() else inside


def _near(
    points: Float[np.ndarray, "n 3"], inside: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians in the box of nearly all of the object, and a margin around it."""
    low, high = np.quantile(points[inside], (0.02, 0.98), axis=0)
    margin = MARGIN * float(np.linalg.norm(high - low))
    return ((points >= low - margin) & (points <= high + margin)).all(1)


SHOWN = 1e-3
"""Pixels that a Gaussian contributes at least to all views, for them to say something of it."""
UNSEEN = 0.15
"""Share of what a Gaussian now contributes, up to which nobody saw it behind the object."""
UNSURE, SURE = 0.5, 0.6
"""Such shares up to which it was seen too little to be believed, and from which it is."""
RIM = 0.06
"""Farthest that the object's rim reaches, of its extent."""
TOUCHED = 0.03
"""Farthest that remains of the object's foot reach on a plane, of its extent."""
AROUND = 0.4
"""Farthest that a Gaussian is believed to look like what was hidden, of the extent."""
OUTLINED = 0.9
"""Share of what it contributes that is in the object's outlines, from which it is enclosed."""
FAINT, HAZE, HAZE_OUTLINED = 0.3, 0.15, 0.6
"""Opacity of haze, its farthest reach, of the extent, and its least share in the outlines."""
ALIKE, ALIKE_SHARE, LEAST_SURE = 0.06, 0.01, 50
"""Distance of two colors that are alike, the share of the sure ones that must be alike, and the
least number of them that says something."""


def strays(
    points: Float[np.ndarray, "n 3"],
    colors: Float[np.ndarray, "n 3"],
    opacities: Float[np.ndarray, " n"],
    thing: Float[np.ndarray, "k 3"],
    extent: float,
    seen: Float[np.ndarray, " n"],
    now: Float[np.ndarray, "3 n"],
    planes: Sequence[Plane],
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians that go with the object.

    `thing` are points of the object, `extent` its own, `seen` what each Gaussian contributed
    while the object was there, `now` what it does without (`contributions_of`). Those go that
    nobody saw, on a plane or near the object; near it, what is enclosed and on no plane; haze that
    is seen before the object more than beside it; and on a plane, what was hardly seen under the
    object, or touches it, and does not look like it: remains of a foot or a shadow.
    """
    all_, outlined, _ = now
    away = k_nearest(thing, points, 1, AROUND * extent)[0][:, 0] / extent
    total = np.maximum(all_, SHOWN)
    trust = np.where(all_ < SHOWN, 1.0, seen / total)
    enclosed = outlined > OUTLINED * total
    layers = [plane.on(points) for plane in planes]
    flat = np.any(layers, 0) if layers else np.zeros(len(points), bool)
    close = away < RIM
    gone = (trust < UNSEEN) & (flat | close) | (enclosed & close & ~flat)
    haze = (opacities < FAINT) & (away < HAZE) & ~flat
    gone |= haze & (outlined > HAZE_OUTLINED * total) & (trust < SURE)
    for plane, layer in zip(planes, layers):
        touched = away < TOUCHED
        under = np.zeros_like(layer)
        shade = thing - plane.heights(thing)[:, None] * plane.normal
        under[layer] = np.isfinite(k_nearest(shade, points[layer], 1, HAZE * extent)[0][:, 0])
        sure = np.flatnonzero(layer & (away < AROUND) & ~touched & (trust > SURE))
        asked = np.flatnonzero(layer & ((under & (trust < UNSURE)) | touched) & ~gone)
        if len(sure) >= LEAST_SURE and len(asked):
            k = max(1, int(ALIKE_SHARE * len(sure)))
            gone[asked[k_nearest(colors[sure], colors[asked], k)[0][:, -1] > ALIKE]] = True
    return gone


ASKED = 2000
"""Points that are asked for their image or their neighbors."""
NEAR = 0.08
"""Farthest that an image lies from where it belongs, of the object's extent."""
LOW = 0.5
"""Share of the object's height whose image is asked for: that of its top is seen least."""
SHARE = 0.6
"""Share of those points that have one: less is a leg of the table, or the soil."""
ASIDE, ALONE = 0.75, 0.5
"""Shift to four sides, of the extent, and the largest share of points that are found there, of
those found below: where all is full of points, as of ground below the top of a rock, none is an
image."""
CLEAR = 0.05
"""Depth under the plane from which there is an image, of the extent: less is the surface itself."""


def mirrored_under(
    thing: Float[np.ndarray, "k 3"],
    others: Float[np.ndarray, "n 3"],
    normal: Float64[np.ndarray, "3"],
    offset: float,
) -> Bool[np.ndarray, " n"]:
    """Flag the points under a plane that are the mirror image of a thing on it; none if few are.

    `normal` (a unit vector) points to the thing's side; points p of the plane have p @ normal ==
    offset.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    heights = others.astype(np.float64) @ normal - offset
    high = thing.astype(np.float64) @ normal - offset
    under = np.flatnonzero((heights < -CLEAR * extent) & (heights > -high.max() - NEAR * extent))
    asked = thing[(high > CLEAR * extent) & (high < LOW * high.max())]
    if not len(under) or not len(asked):
        return flags
    images = others[under] - 2 * heights[under, None] * normal
    some = asked[:: 1 + len(asked) // ASKED]
    share = _share(images, some, extent)
    across = np.linalg.svd(normal[None])[2][1:] * ASIDE * extent
    beside = [_share(images, some + way, extent) for way in (*across, *-across)]
    if share < SHARE or np.median(beside) > ALONE * share:
        return flags
    flags[under] = np.isfinite(k_nearest(thing, images, 1, NEAR * extent)[0][:, 0])
    return flags


def _share(
    images: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "k 3"], extent: float
) -> float:
    """Share of points that have an image near them."""
    return float(np.isfinite(k_nearest(images, points, 1, NEAR * extent)[0]).mean())


LOW_PART = 0.12
"""Height over the ground up to which parts lie between the feet of an object, of its extent."""
WITHIN, AROUND_IT, OPEN = 0.9, 8, 0.5
"""Least share of such a part that is within the object's outline from above, the cells around the
object that are looked at, and the share of its rectangle that an open part fills."""


def between_feet(
    thing: Float[np.ndarray, "k 3"],
    others: Float[np.ndarray, "n 3"],
    plane: Plane,
) -> Bool[np.ndarray, " n"]:
    """Flag the points of what stands low on a plane, within a thing's outline from above, and
    touches its feet, as the beams between the legs of a table.

    What is wholly below the thing carries it, and stays, unless it is open, as crossed beams.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    axes = np.linalg.svd(plane.normal[None])[2][1:]
    own, heights = plane.heights(thing), plane.heights(others)
    step = CELL * extent
    flat = thing @ axes.T / step
    least = flat.min(0) - AROUND_IT
    shape = np.ceil(flat.max(0) - least).astype(int) + AROUND_IT

    def cells(points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 2"]:
        return np.floor(points @ axes.T / step - least).astype(int)

    foot, outline, taken = (np.zeros(shape, bool) for _ in range(3))
    foot[tuple(cells(thing[own < LOW_PART * extent]).T)] = True
    outline[tuple(cells(thing).T)] = True
    outline = enclosing(closed(outline, 2))
    at = cells(others)
    near = np.flatnonzero(((at >= 0) & (at < shape)).all(1) & (heights > plane.band))
    at, near_low = at[near], heights[near] < LOW_PART * extent
    taken[tuple(at[near_low].T)] = True
    numbers, _ = parts_of(taken)
    part, beside = numbers[tuple(at.T)], np.unique(numbers[widened(foot, 1) & (numbers > 0)])
    for each in beside:
        own_low, high = (near[(part == each) & which] for which in (near_low, ~near_low))
        inside = outline[numbers == each].mean() >= WITHIN and len(high) < len(own_low) / 2
        is_open = (numbers == each).sum() < OPEN * rectangle_around(numbers == each).sum()
        flags[own_low] = inside and (is_open or np.median(heights[own_low]) > own.min())
    return flags


MOSTLY, LEAST_JOINT = 0.5, 3
"""Least share of an object that is selected, for the rest of it to be meant, and the least pairs of
neighbors that join the two."""


def missed(surfaces: Surfaces, inside: Bool[Tensor, " n"]) -> Bool[np.ndarray, " m"]:
    """Flag the surfaces that a selection of most of an object missed: parts of the same object that
    are joined to what is selected. What is wholly below that carries it, and stays."""
    segments = segment_surfaces(surfaces)
    chosen = surfaces.gathered(inside) & surfaces.solid
    if not chosen.any():
        return chosen
    own = segments.inside(int(segments.labels[torch.from_numpy(chosen)].mode().values)).numpy()
    own &= surfaces.solid & (chosen | ~block_under(surfaces, own))
    rest, kept = own & ~chosen, own & chosen
    if kept.sum() < MOSTLY * own.sum() or not rest.any():
        return np.zeros_like(own)
    part = numbered(linked(surfaces.edges[rest[surfaces.edges].all(1)], len(surfaces)), rest)
    joints = np.bincount(part[rest], surfaces.touches(rest, kept)[rest])
    high = surfaces.heights > np.quantile(surfaces.heights[kept], 0.01)
    above = np.bincount(part[rest], high[rest]) > 0.5 * np.bincount(part[rest])
    return rest & ((joints >= LEAST_JOINT) & above)[part]


REACH = 1.0
"""Width around the object's box that is looked at, of its extent."""
CELL, SPACED = 0.04, 2.5
"""Least side of a cell, of the extent, and of the usual distance of neighbors."""
REACHES_DOWN = 0.1
"""Height to which what stands beside the object reaches down, of the object's."""
LEAST_SIZE = 0.1
"""Least extent of what is worth a word, of the object's: less is a crumb of its rim."""


def resting_on(
    thing: Float[np.ndarray, "k 3"],
    others: Float[np.ndarray, "n 3"],
    up: Float64[np.ndarray, "3"],
) -> Bool[np.ndarray, " n"]:
    """Flag the points of what lies right on top of a thing and touches nothing beside or below.

    `others` are the points that are left; what reaches down beside the thing, or far from it, is
    held by something else.
    """
    extent, flags = extent_of(thing), np.zeros(len(others), bool)
    axes = np.linalg.svd(up[None])[2]
    axes[0] = up
    own, rest = thing @ axes.T, others.astype(np.float64) @ axes.T
    low, high = own.min(0) - REACH * extent, own.max(0) + REACH * extent
    low[0] = own[:, 0].min() + REACHES_DOWN * np.ptp(own[:, 0])
    near = np.flatnonzero(((rest > low) & (rest < high)).all(1))
    if len(near) < 2 or extent <= 0:
        return flags
    some = rest[near[:: 1 + len(near) // ASKED]]
    spacing = float(np.median(k_nearest(rest[near], some, 2)[0][:, 1]))
    step = max(CELL * extent, SPACED * spacing)

    def cells(points: Float[np.ndarray, "m 3"]) -> tuple[np.ndarray, ...]:
        return tuple(((points - low) / step).astype(int).T)

    taken, filled = (np.zeros(np.ceil((high - low) / step).astype(int), bool) for _ in range(2))
    taken[cells(rest[near])] = True
    filled[cells(own[own[:, 0] > low[0]])] = True
    found: Any = ndimage.label(taken, np.ones((3, 3, 3)))
    parts = found[0]
    above = np.zeros_like(filled)
    above[2:] = filled[1:-1] | filled[:-2]
    inner = np.zeros_like(filled)
    inner[1:-1, 1:-1, 1:-1] = True
    loose = np.setdiff1d(parts[above & ~filled], np.append(parts[~inner], 0))
    for part in loose:
        rows = near[parts[cells(rest[near])] == part]
        flags[rows] = extent_of(others[rows]) > LEAST_SIZE * extent
    return flags


VIEWS, VIEW_PIXELS = 48, 256
"""Most views that are asked, and the longer side of their pictures."""
LARGE, FEW_VIEWS = 500_000, 20
"""Gaussians of a scene of which fewer views are asked, and how many."""
MOST_POINTS = 20_000
"""Gaussians of the object that distances are taken from."""
FIRM = 0.3
"""Opacity from which a Gaussian is a part of something that casts a shadow of its own."""
TALL = 2.5
"""Standard deviations to which Gaussians under a hole reach: they would show through what fills it.
"""
LEAST_GUESS = 0.01
"""Share of what the object hid that is worth a word where nobody saw it."""
CONTACT, DIMMED = 3, 0.95
"""Width around a hole, cells, that is made up, too, where less than such a share of the light is
left: close to the contact shadows are steeper than they can be told."""
MOST_GAPS = 3
"""Views in which what lies on no plane is continued."""


@cached_per_scene
@torch.no_grad()
def remove(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    cameras: Sequence[Camera] = (),
) -> Outcome:
    """Remove the Gaussians `inside` with what belongs to them, and fill what nobody saw.

    Along go the object's rim, what floats in it, what no camera saw behind it, and its shadow on
    the planes around it. A plane (ground, table, walls) goes on under it with its own texture; what
    lies on no plane goes on smoothly in depth. All other Gaussians keep their bits. Without
    `cameras`, some are found.

    Raises UsageError for a selection that is empty, everything, or seen by no camera, and for
    values that are not finite.
    """
    _check(scene, inside)
    inside = torch.from_numpy(tidied(scene.means.numpy(), inside.numpy()))
    cameras = cameras_of(scene, cameras)
    surfaces = look_at_surfaces(scene, cameras)
    inside = inside | surfaces.expanded(torch.from_numpy(missed(surfaces, inside)))
    most = VIEWS if len(scene) < LARGE else FEW_VIEWS
    asked = [cameras[i].fitted(VIEW_PIXELS) for i in evenly_spaced(len(cameras), most)]
    thing, kept, trust, planes, bare = _looked_behind(scene, inside, cameras, asked)
    more = _standing_between(scene.means[kept].numpy(), thing, planes[0], bare) if planes else []
    if np.any(more):
        inside = inside.index_fill(0, kept[torch.from_numpy(more)], True)
        thing, kept, trust, planes, bare = _looked_behind(scene, inside, cameras, asked)
    left = _Left(scene, kept, torch.zeros(len(kept), dtype=torch.bool), trust, scene[kept], [], 0)
    left, views = _planes_filled(left, planes, thing, bare)
    left, views = _gaps_filled(left, views)
    firm = scene.means[left.rows][left.rest.opacities > FIRM].numpy()
    resting = int(resting_on(thing.points, firm, up_of(cameras).double().numpy()).sum())
    return left.outcome(_notes(inside, left, len(bare.sights), guessed(bare, views), resting))


def _looked_behind(
    scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera], asked: Sequence[Camera]
) -> tuple[Object, Int[Tensor, " k"], Float[Tensor, " k"], tuple[Plane, ...], Views]:
    """The object, what `_without` tells of the rest, and the asked views without the object."""
    sights, seen = look(scene, inside, asked)
    if not sights:
        raise UsageError(
            "no camera sees what is selected: give cameras that do, or leave it out with "
            "'gsedit filter'"
        )
    thing = _object(scene, inside, cameras)
    kept, trust, planes = _without(scene, inside, thing.extent, sights, seen)
    return thing, kept, trust, planes, look_again(scene[kept], sights)


def _standing_between(
    points: Float[np.ndarray, "k 3"], thing: Object, ground: Plane, bare: Views
) -> Bool[np.ndarray, " k"]:
    """Flag what stands between the feet of a thing: most views of the ground under it show it."""
    heights = ground.heights(points)
    away = np.linalg.norm(points - thing.center, axis=1)
    low = (heights > ground.band) & (heights < LOW_PART * thing.extent) & (away < thing.extent)
    eyes = np.stack([sight.camera.center.double().numpy() for sight in bare.sights])
    under = points[low] - heights[low, None] * ground.normal
    shown, _, beside, covered = testify(under, ground.heights(eyes), bare, ground.band)
    asked = np.flatnonzero(heights >= LOW_PART * thing.extent)
    asked = np.union1d(asked, np.flatnonzero(low)[covered > shown + beside])
    flags = np.zeros(len(points), bool)
    flags[asked] = between_feet(thing.points, points[asked], ground)
    return flags


def _planes_filled(
    left: _Left, planes: Sequence[Plane], thing: Object, views: Views
) -> tuple[_Left, Views]:
    """Fill the holes of planes and take the object's shadow off them, one after the other."""
    for plane in planes:
        others = [other for other in planes if other is not plane]
        sheet = find_sheet(left.rest, plane, others, thing, views)
        if sheet is None:
            continue
        if sheet.glossy:
            sheet = as_seen(left.before, sheet, plane, thing, views)
        else:
            left, sheet = _lit(left, sheet, plane, thing.extent)
        left = left.without(_in_hole(left, sheet, plane))
        made, textured = filled(left.rest, sheet, plane)
        left = left.plus(made, textured)
        views = look_again(left.scene, views.sights)
    return left, views


def _gaps_filled(left: _Left, views: Views) -> tuple[_Left, Views]:
    """Continue what lies on no plane in those views that show the largest holes."""
    for _ in range(MOST_GAPS):
        gap = find_gap(views)
        if gap is None:
            break
        made, textured = backdrop(left.scene, *gap, views.sights)
        if not len(made):
            break
        left = left.plus(made, textured)
        views = look_again(left.scene, views.sights)
    return left, views


@dataclass(frozen=True, eq=False)
class _Left:
    """Remaining Gaussians of a scene, and those that were made for it."""

    before: Gaussians
    rows: Int[Tensor, " k"]
    changed: Bool[Tensor, " k"]
    trust: Float[Tensor, " k"]
    """Share of what each contributes now that it did while the object was there."""
    rest: Gaussians
    """Those rows, changed or not."""
    made: list[Gaussians]
    smooth: int
    """How many of them have no texture."""

    @property
    def scene(self) -> Gaussians:
        return concatenate(self.rest, *self.made)

    def without(self, gone: Bool[np.ndarray, " k"]) -> _Left:
        stay = torch.from_numpy(~gone)
        rows, changed, trust, rest = (
            each[stay] for each in (self.rows, self.changed, self.trust, self.rest)
        )
        return replace(self, rows=rows, changed=changed, trust=trust, rest=rest)

    def plus(self, more: Gaussians, textured: bool) -> _Left:
        smooth = self.smooth + (0 if textured else len(more))
        return replace(self, made=[*self.made, more], smooth=smooth)

    def outcome(self, notes: tuple[str, ...]) -> Outcome:
        count = sum(map(len, self.made))
        new = torch.ones(count, dtype=torch.bool)
        origin = torch.cat((self.rows, torch.full((count,), NEW)))
        return Outcome(self.scene, origin, torch.cat((self.changed, new)), notes)


def _lit(left: _Left, sheet: Sheet, plane: Plane, extent: float) -> tuple[_Left, Sheet]:
    """Take the object's shadow off a plane; what it blackened, and its contact, join the hole."""
    points = left.rest.means.numpy()
    cell = sheet.at(points)
    others = standing(sheet, plane, points[left.rest.opacities.numpy() > FIRM], extent)
    light, deep = find_shade(
        sheet.values[..., :3], sheet.known, sheet.hole, sheet.caster, others, extent / sheet.cell
    )
    own = light.reshape(-1, 1)[cell]
    dark = torch.from_numpy(plane.on(points) & (cell >= 0) & (own < 1)[:, 0])
    brighter = (1 / torch.from_numpy(own)).to(left.rest.sh)[dark, None]
    sh = left.rest.sh.clone()
    sh[dark] *= brighter
    sh[dark, :1] += 0.5 / SH_DC * (brighter - 1)
    contact = widened(sheet.hole, CONTACT) & (light[..., 0] < DIMMED)
    hole = sheet.hole | deep | (contact & sheet.known)
    sheet = replace(sheet, values=sheet.values / light, known=sheet.known & ~hole, hole=hole)
    return replace(left, changed=left.changed | dark, rest=replace(left.rest, sh=sh)), sheet


def _in_hole(left: _Left, sheet: Sheet, plane: Plane) -> Bool[np.ndarray, " k"]:
    """Flag the Gaussians in the hole of a sheet, and those under it that reach up to the plane and
    that nobody saw: what was seen is a side of what the surface ends at."""
    scene, points = left.rest, left.rest.means.numpy()
    held = np.flatnonzero(sheet.holds(points))
    some = scene[torch.from_numpy(held)]
    normal = torch.from_numpy(plane.normal).to(some.means)
    across = (rotation_matrices(some.quats).mT @ normal * some.scales).norm(dim=-1).numpy()
    height = plane.heights(points[held])
    under = (height < 0) & (height > -TALL * across - plane.band)
    inside = (np.abs(height) < plane.band) | (under & (left.trust.numpy()[held] < SURE))
    gone = np.zeros(len(points), bool)
    gone[held[inside]] = True
    return gone


def _check(scene: Gaussians, inside: Bool[Tensor, " n"]) -> None:
    if len(inside) != len(scene):
        raise UsageError(f"{len(inside)} flags for {len(scene)} Gaussians: give one a Gaussian")
    if not inside.any():
        raise UsageError("nothing is selected: select the object that is to be removed")
    if inside.all():
        raise UsageError("the selection is the whole scene: select one object of it")
    check_finite(scene)


def _without(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    extent: float,
    sights: Sequence[Sight],
    seen: Float[Tensor, " n"],
) -> tuple[Int[Tensor, " k"], Float[Tensor, " k"], tuple[Plane, ...]]:
    """Rows of what stays, how much of each was seen before, and the planes around the object."""
    points, removed = scene.means.numpy(), inside.numpy()
    rest = (~inside).nonzero().squeeze(1)
    kept = scene[rest]
    now = contributions_of(kept, sights).numpy()
    weights = np.zeros(len(scene))
    weights[rest.numpy()] = now[2]
    up = up_of([sight.camera for sight in sights]).double().numpy()
    eye = np.mean([sight.camera.center.double().numpy() for sight in sights], 0)
    planes = find_planes(
        points, core_of(points, removed), shortest_axes(scene).numpy(), weights, eye, up
    )
    colors = sh_to_color(kept.sh[:, 0]).numpy()
    some = points[removed][:: 1 + int(removed.sum()) // MOST_POINTS]
    left, opaque = points[rest.numpy()], kept.opacities.numpy()
    gone = strays(left, colors, opaque, some, extent, seen[rest].numpy(), now, planes)
    if planes:
        ground = planes[0]
        gone |= mirrored_under(points[removed], left, ground.normal, ground.offset)
    stay = torch.from_numpy(~gone)
    trust = seen[rest][stay] / torch.from_numpy(now[0])[stay].clamp_min(SHOWN)
    return rest[stay], trust, planes


def _object(scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera]) -> Object:
    """The object that is removed, and the median size of the cameras' pixels at it."""
    points = scene.means[inside].double().numpy()
    center = np.median(points, 0)
    eyes = np.stack([camera.center.double().numpy() for camera in cameras])
    away = np.linalg.norm(eyes - center, axis=1)
    sizes = [a / c.fx if c.model == "pinhole" else 1 / c.fx for a, c in zip(away, cameras)]
    least = max(SMALLEST * extent_of(scene.means.numpy()), 1e-9)
    return Object(points, center, max(extent_of(points), least), float(np.median(sizes)))


def _notes(
    inside: Bool[Tensor, " n"], left: _Left, views: int, guess: float, resting: int
) -> tuple[str, ...]:
    """Remarks on what went, what was made up (a share of what the object hid), what hangs now."""
    gone = len(left.before) - len(left.rows)
    strays_, made = gone - int(inside.sum()), sum(map(len, left.made))
    notes = [f"{gone:,} Gaussians left ({strays_:,} beyond the selection), {made:,} fill the hole"]
    if guess >= LEAST_GUESS:
        notes.append(f"no camera saw {guess:.0%} of what the object hid: that is made up")
    if views == 1:
        notes.append("one view shows the object: from elsewhere what was behind it is a guess")
    if left.smooth:
        share = left.smooth / made
        notes.append(f"too little is known around {share:.0%} of the hole: it is filled smooth")
    if resting:
        notes.append(
            f"what stood on it hangs in the air now ({resting:,} Gaussians): remove or move it, too"
        )
    return tuple(notes)
