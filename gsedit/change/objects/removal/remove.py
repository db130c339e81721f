"""Remove an object and fill what nobody saw behind it.

Along go Gaussians that belong to it beyond what was selected: its rim and floaters, its mirror
image. What stood on it and hangs in the air is told.
`n` Gaussians before, or of what is left; `m` after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.change.objects.removal.belongings import (
    LOW_PART,
    SHOWN,
    SURE,
    between_feet,
    core_of,
    left_on,
    mirrored_under,
    missed,
    strays,
    tidied,
)
from gsedit.change.objects.removal.cells import widened
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
from gsedit.scene.neighbors import extent_of
from gsedit.scene.outcome import NEW, Outcome, check_finite
from gsedit.scene.planes import SMALLEST, Plane, find_planes
from gsedit.select.segment import segment_surfaces
from gsedit.select.surfaces import look as look_at_surfaces
from gsedit.views.around import cameras_of
from gsedit.views.dataset import evenly_spaced
from gsedit.views.normals import shortest_axes
from gsedit.views.paths import up_of
from rasterizer.camera import Camera
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians, concatenate

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
def remove(scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera] = ()) -> Outcome:
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
    segments = segment_surfaces(surfaces)
    inside = inside | surfaces.expanded(torch.from_numpy(missed(surfaces, segments, inside)))
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
    gone = torch.ones_like(inside).index_fill(0, left.rows, False)
    resting = surfaces.expanded(torch.from_numpy(left_on(surfaces, segments, gone))).sum()
    return left.outcome(_notes(inside, left, len(bare.sights), guessed(bare, views), int(resting)))


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
