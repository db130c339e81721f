"""Gaussians that fill what an object hid: the hole of a sheet, or of a view that shows no plane.

Where a sheet's texture was copied, the Gaussians are copied that made it, so that they have its
grain, roughness and view dependence; under them, and elsewhere, lies a layer of flat discs.
`n` Gaussians; `h w` cells or pixels; `k` harmonics a channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsedit.change.objects.removal.cells import away_from, depth_in, mean_around, widened
from gsedit.change.objects.removal.complete import Completed, complete, solve_membrane
from gsedit.change.objects.removal.sheet import Object, Sheet
from gsedit.change.objects.removal.sight import SAME_DEPTH, Sight, Views, beside_image, testify
from gsedit.scene.planes import DEEPER, Plane
from gsedit.scene.quaternions import quaternion_of, turn_between
from rasterizer.camera import Camera
from rasterizer.harmonics import basis
from rasterizer.numerics import SH_DC, color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

DISC, FLATNESS, OPACITY = 0.7, 0.1, 0.985
"""Standard deviation of a disc in cells, its thickness against it, and its opacity: neighbors
leave no gaps (gsedit.bench.synthetic.splats)."""
REACH = 2.0
"""Standard deviations to which a copy reaches: it must not stand over the edge of its surface."""
SMOOTHED = 0.1
"""Standard deviation over which view dependence is averaged, of the hole's size."""


def filled(kept: Gaussians, sheet: Sheet, plane: Plane) -> tuple[Gaussians, bool]:
    """The Gaussians of a sheet's hole, and whether they have texture; `kept` is what is left of the
    scene."""
    if sheet.glossy:
        rimmed = replace(sheet, hole=widened(sheet.hole, RIM))
        return _discs(rimmed, plane, sheet.values[..., :3], plane.band, kept), True
    done = complete(sheet.values[..., :3], around(sheet.known, sheet.hole), sheet.hole)
    copies = _copies(kept, sheet, plane, done)
    sink = DEEPER * plane.band if len(copies) else 0.0
    return concatenate(copies, _discs(sheet, plane, done.picture, sink, kept)), done.textured


def around(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Flag what is known near a hole: its texture goes on there, and no other surface's."""
    return known & (away_from(hole) < 3 + SURROUNDINGS * np.sqrt(hole.sum()))


def _copies(kept: Gaussians, sheet: Sheet, plane: Plane, done: Completed) -> Gaussians:
    """The plane's Gaussians, copied along the shifts of the hole's cells, in its light."""
    points = kept.means.numpy()
    cell = sheet.at(points)
    rows = np.flatnonzero(plane.held(points) & (cell >= 0) & sheet.known.reshape(-1)[cell])
    rows = rows[np.argsort(cell[rows], kind="stable")]
    target = np.flatnonzero(sheet.hole & done.textured)
    source = (done.source @ (sheet.hole.shape[1], 1)).reshape(-1)[target]
    first = np.searchsorted(cell[rows], source).astype(np.int64)
    counts = (np.searchsorted(cell[rows], source, "right") - first).astype(np.int64)
    nth = np.arange(counts.sum()) - np.repeat(counts.cumsum() - counts, counts)
    taken = torch.from_numpy(rows[np.repeat(first, counts) + nth])
    pairs = np.repeat(np.stack((target, source)), counts, axis=1)
    room = (depth_in(sheet.hole | sheet.known).reshape(-1)[pairs[0]] + 1) * sheet.cell
    fits = np.flatnonzero(REACH * kept.scales[taken].amax(1).numpy() < room)
    scene, (target, source) = kept[taken[torch.from_numpy(fits)]], pairs[:, fits]
    places, color = sheet.points(), done.picture.reshape(-1, 3)
    moved = torch.from_numpy(places[target] - places[source]).to(scene.means)
    light = torch.from_numpy((color[target] - color[source]) / SH_DC).to(scene.sh)
    sh = torch.cat((scene.sh[:, :1] + light[:, None], scene.sh[:, 1:]), 1)
    return replace(scene, means=scene.means + moved, sh=sh)


def _discs(
    sheet: Sheet, plane: Plane, picture: Float[np.ndarray, "h w 3"], sink: float, like: Gaussians
) -> Gaussians:
    """A layer of discs, one a cell, under the plane by `sink` world units."""
    at = sheet.hole.reshape(-1)
    points = torch.from_numpy(sheet.points()[at] - sink * plane.normal)
    count = len(points)
    bands = _bands(sheet)[sheet.hole]
    own = (picture[sheet.hole] - 0.5) / SH_DC - np.einsum("pkc,k->pc", bands, sheet.usual[1:])
    sh = torch.from_numpy(np.concatenate((own[:, None], bands), 1))
    size = torch.tensor((DISC, DISC, DISC * FLATNESS)).double() * sheet.cell
    turn = quaternion_of(turn_between(np.array((0.0, 0.0, 1.0)), plane.normal))
    opacity = torch.full((count,), OPACITY).double().logit()
    made = Gaussians(
        points,
        torch.from_numpy(turn).expand(count, 4).contiguous(),
        size.log().expand(count, 3).contiguous(),
        opacity,
        sh,
    )
    return made.to(like.means.dtype)


def _bands(sheet: Sheet) -> Float64[np.ndarray, "h w k 3"]:
    """Harmonics above the first: those of what is known around, smooth."""
    bands = sheet.values[..., 3:]
    shape = (*sheet.hole.shape, bands.shape[-1] // 3, 3)
    if not bands.shape[-1] or not sheet.known.any():
        return np.zeros(shape)
    sigma = SMOOTHED * np.sqrt(sheet.hole.sum())
    mean = mean_around(bands, sheet.known.astype(np.float64), sigma)
    rim = sheet.known & widened(sheet.hole, 2)
    return solve_membrane(mean, ~rim, rim).reshape(shape)


EVEN, RIM, STEADY = 6.0, 2, 1e-3
"""Standard deviation over which colors of a reflecting part are averaged, width by which it goes on
under its rim, cells, and ridge of its view dependence: views are from a few sides only."""


@torch.no_grad()
def as_seen(scene: Gaussians, sheet: Sheet, plane: Plane, thing: Object, views: Views) -> Sheet:
    """A sheet whose hole reflects, in the colors that views of the scene with the object saw there
    beside its mirror image: each cell has its own, and all have one view dependence."""
    hole, image = sheet.hole, thing.points - 2 * plane.heights(thing.points)[:, None] * plane.normal
    places = sheet.points()[hole.reshape(-1)]
    eyes = torch.stack([sight.camera.center.double() for sight in views.sights])
    colors, shown = [], []
    for sight, height in zip(views.sights, plane.heights(eyes.numpy()).tolist()):
        row, column, free = beside_image(places, image, sight, height, plane.band)
        shown.append(free)
        colors.append(render(scene, sight.camera).color.double()[row, column])
    seen, at = torch.stack(colors), torch.from_numpy(np.stack(shown))
    ways = torch.nn.functional.normalize(torch.from_numpy(places) - eyes[:, None], dim=-1)
    factors = basis(ways.reshape(-1, 3), scene.degree).reshape(*at.shape, -1)
    usual = factors[at].mean(0)
    across = (factors - usual)[..., 1:]
    some, color = across[at], seen[at] - seen[at].mean(0)
    square = some.T @ some + STEADY * len(some) * torch.eye(some.shape[1])
    bands = torch.linalg.solve(square, some.T @ color)
    own = (seen - across @ bands).masked_fill(~at[..., None], torch.nan).nanmedian(0).values
    values, sure = sheet.values.copy(), np.zeros_like(hole)
    sure[hole] = (at.sum(0) >= at.sum(0).median()).numpy()  # the rest is hidden by the object
    values[hole, :3] = own.nan_to_num().numpy()
    values[..., 3:] = bands.reshape(-1)
    even = mean_around(values[..., :3], sure.astype(np.float64), EVEN)
    values[..., :3] = solve_membrane(even, widened(hole, RIM) & ~sure, sure)
    return replace(sheet, values=values, usual=usual.numpy() / SH_DC)


LEAST_HOLE = 0.01
"""Least hole, of the object's outline: less is not worth a layer."""
SOLID = 0.5
"""Opacity of a pixel, below which it is open."""
SURROUNDED = 0.8
"""Opacity that what is around must continue to: else there is nothing behind the object."""
KNOWN = 0.9
"""Opacity of a pixel that is known."""
SURROUNDINGS = 1.0
"""Width of what is known around a hole that is looked at, of the hole's size."""


def find_gap(views: Views) -> tuple[Camera, Bool[np.ndarray, "h w"]] | None:
    """(camera, hole) of the view with the largest hole in the object's outline; None: none has any.

    Where nothing is around the outline, there is no hole: the object was before nothing.
    """
    best, largest = None, 0.0
    for sight, alpha in zip(views.sights, views.alpha):
        around = sight.ring | ~sight.outline
        open_ = sight.outline & (alpha < SOLID)
        if open_.sum() <= max(LEAST_HOLE * sight.outline.sum(), largest) or not around.any():
            continue
        full = solve_membrane(alpha[..., None].astype(np.float64), sight.outline, around)[..., 0]
        hole = open_ & (full > SURROUNDED)
        if hole.sum() > max(LEAST_HOLE * sight.outline.sum(), largest):
            best, largest = (sight.camera, hole), float(hole.sum())
    return best


@torch.no_grad()
def backdrop(
    scene: Gaussians, camera: Camera, hole: Bool[np.ndarray, "h w"], sights: Sequence[Sight]
) -> tuple[Gaussians, bool]:
    """A layer of Gaussians, one a pixel of the hole, and whether it has texture.

    Inverse depth goes on smoothly from what is around.
    """
    shown = render(scene, camera, median_depth=True)
    depth = shown.median_depth
    assert depth is not None
    solid = (shown.alpha.numpy() > KNOWN) & (depth.numpy() > 0)
    known = around(solid & ~hole, hole)
    done = complete(shown.color.double().numpy(), known, hole)
    inverse = 1 / np.where(known, depth.double().numpy(), 1.0)
    smooth = solve_membrane(inverse[..., None], hole, known)[hole][:, 0]
    far = torch.from_numpy(1 / np.maximum(smooth, 1e-9))
    made = _layer(scene, camera, hole, far, torch.from_numpy(done.picture[hole]))
    before = Views(sights, [sight.depth for sight in sights], [])
    places = made.means.double().numpy()
    _, through, free, _ = testify(places, np.ones(len(sights)), before, SAME_DEPTH)
    return made[torch.from_numpy(through <= 0.5 * free)], done.textured


def _layer(
    scene: Gaussians,
    camera: Camera,
    hole: Bool[np.ndarray, "h w"],
    depth: Float[Tensor, " m"],
    colors: Float[Tensor, "m 3"],
) -> Gaussians:
    """Discs that face the camera, as wide as their pixels."""
    count = len(depth)
    points = camera.unproject(camera.pixel_centers()[torch.from_numpy(hole)], depth)
    sh = torch.zeros(count, scene.sh.shape[1], 3).double()
    sh[:, 0] = color_to_sh(colors)
    pixel = (
        depth / camera.fx if camera.model == "pinhole" else torch.full_like(depth, 1 / camera.fx)
    )
    flat = torch.tensor((1.0, 1.0, FLATNESS)).double()
    quat = torch.from_numpy(quaternion_of(camera.rotation.double().numpy().T))
    return Gaussians(
        points,
        quat.expand(count, 4).contiguous(),
        (DISC * pixel[:, None] * flat).log(),
        torch.full((count,), OPACITY).double().logit(),
        sh,
    ).to(scene.means.dtype)
