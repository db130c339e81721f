"""A plane as a picture, seen straight from above: the part of it that nobody saw, what is known
around that, and the shadow of the object on it.

The surface around the object is made up from what is farther off, as if it were unknown: where it
is darker than that, evenly in all colors or fading out, the object's shadow lies.
`n` Gaussians; a picture of `h w` cells; `k` harmonics a channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int64
from scipy.ndimage import gaussian_filter, grey_dilation
from scipy.spatial import Delaunay

from gsedit.change.objects.removal.cells import (
    away_from,
    closed,
    enclosing,
    mean_around,
    opened,
    parts_of,
    rectangle_around,
    touching,
    widened,
)
from gsedit.change.objects.removal.complete import solve_membrane
from gsedit.change.objects.removal.sight import Views, testify
from gsedit.scene.planes import Plane
from gsedit.views.orbit import parallel, perpendicular
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.harmonics import basis
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians


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
    glossy: bool = False
    """Whether the hole is a part that reflects: its color is the one that views saw there."""

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

    def under(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "h w"]:
        """Flag the cells that points lie over or under, without small gaps."""
        cells = self.at(points)
        found = np.zeros(self.hole.size, bool)
        found[cells[cells >= 0]] = True
        return closed(found.reshape(self.hole.shape), 2)

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
    down = torch.from_numpy(-plane.normal)
    up = torch.linalg.cross(down, perpendicular(down))
    width, height = (max(4, int(np.ceil(2 * each / cell))) for each in half)
    return parallel(torch.from_numpy(middle), -down, up, cell, (width, height), 2 * plane.band)


def harmonics_on(
    layer: Gaussians, camera: Camera
) -> tuple[Float[np.ndarray, "h w k3"], Float[np.ndarray, "h w"]]:
    """Harmonics blended as colors are, and the opacity."""
    if not len(layer):
        shape = (camera.height, camera.width)
        return np.zeros((*shape, layer.sh.shape[1] * 3)), np.zeros(shape)
    weights = color_weights(layer, camera)
    alpha = weights.picture(torch.ones(len(layer), 3).to(layer.means))[..., 0]
    bands = [weights.picture(layer.sh[:, k].contiguous()) for k in range(layer.sh.shape[1])]
    values = torch.cat(bands, -1) / alpha.clamp_min(1e-3)[..., None]
    return values.double().numpy(), alpha.double().numpy()


COVERED, GAP = 0.6, 2
"""Opacity from which a cell is known; half of the width, in cells, of gaps that are known where
views saw them: between blades of grass."""
THIN_LAYER, WITNESSES = 0.3, 0.35
"""Opacity from which a cell is known that views saw, so many at least of those that the object hid
it from: surfaces of a rough fit are thin from above."""
HIDDEN = (0.5, 2.0)
"""Least views that the object hid a cell from, of those that saw it, for a cell of the hole, and
for one that nobody knows."""
NEARBY = 0.1
"""Farthest that cells of a hole are from such a one, of the object's extent: what is seen under a
table is there, though not quite on its plane."""
OPEN = 1.0
"""Least views that show a cell of the hole, of those that something else covers it in: a surface
that is not level lies over its plane, or is seen before it."""
BORDERED = 0.25
"""Least share of what is around a hole that is known: else it is a hole of something else."""
OWN = 0.25
"""Least share of a hole that nobody knows: else it is the footprint of something else."""
FULL = 0.9
"""Share of a rectangle without its hole that is known, from which a surface is that rectangle."""
SEEN = 0.05
"""Views, averaged around a cell, up to which what is behind another plane is unknown."""
SEEN_THROUGH = 0.34
"""Share of the views that nothing hides a place from, at most, that saw through it."""
EDGE = 2.0
"""Standard deviation over which that is averaged, cells: edges of surfaces are even."""
BEHIND = 0.03
"""Share of what is known of a plane that may lie behind another one that ends it: a corner."""
LEAST_CELLS, LEAST_FINE_CELLS = 6, 2
"""Cells of the smallest hole, coarse and fine: a smaller one is closed by what is around it."""
MOST_OF, AMID = 0.7, 2
"""Least share of an object's foot that is on a part that reflects, and of its hull filled; and most
of the part, of the surface known around it: views see through more where a fit is thin."""
CLOSE = 0.1
"""Distance of the object's parts that are close over a plane, of its extent."""
NOTCH = 0.05
"""Half of the width, of that extent, of notches in a surface's edge that the object stood on."""
SPECK = 0.1
"""Size of a hole, of the largest, below which it is not worth a larger picture."""
COARSE = 160
"""Cells along the longer side of the picture in which the hole is found."""
MOST_CELLS = 320
"""Cells along the longer side of the picture that is completed."""
REACH = 1.5
"""Radius around the object in which planes are filled, of its extent."""
SURROUNDINGS = 0.6
"""Width of what is known around a hole, of the hole's size, that its texture is taken from."""

NEIGHBORHOOD = 1.0
"""Least such width, of the object's extent: a shadow lies within."""
NEAR_HOLE = 3
"""Half of the width, in cells, of gaps of a hole in which thin remains are not believed."""
ISLAND = 0.1
"""Width of what is known amid a hole, of the hole's, below which it is remains of the object."""


@dataclass(frozen=True, eq=False)
class Object:
    """The object that is removed."""

    points: Float64[np.ndarray, "k 3"]
    """Centers of its Gaussians."""
    center: Float64[np.ndarray, "3"]
    extent: float
    pixel: float
    """Size of the cameras' pixels at it, world units."""


def find_sheet(
    kept: Gaussians, plane: Plane, others: Sequence[Plane], thing: Object, views: Views
) -> Sheet | None:
    """The part of a plane that nobody saw or the object stood on, with what is known around it.

    `kept` is what is left of the scene, `others` its other planes. None where there is no such
    part.
    """
    points = kept.means.numpy()
    layer = kept[torch.from_numpy(plane.held(points))]
    middle = thing.center - plane.heights(thing.center[None])[0] * plane.normal
    radius = REACH * thing.extent
    camera = above(plane, middle, np.array((radius, radius)), 2 * radius / COARSE)
    rough = _drawn(layer, plane, others, camera, LEAST_CELLS, thing, views)
    if not (rough.hole | (rough.caster & rough.known)).any():
        return None
    low, high = _frame(rough, thing.extent)
    at = torch.from_numpy((low + high) / 2)[None]
    middle = camera.unproject(at, torch.full((1,), rough.depth).double())[0].numpy()
    half = (high - low) / 2 * rough.cell
    fine = max(thing.pixel, 2 * float(half.max()) / MOST_CELLS)
    camera = above(plane, middle, half, fine)
    return _drawn(layer, plane, others, camera, LEAST_FINE_CELLS, thing, views)


def _drawn(
    layer: Gaussians,
    plane: Plane,
    others: Sequence[Plane],
    camera: Camera,
    least: int,
    thing: Object,
    views: Views,
) -> Sheet:
    """The picture of a rectangle of a plane."""
    depth = 2 * plane.band
    eyes = np.stack([s.camera.center.double().numpy() for s in views.sights])
    points = cells_of(camera, depth)
    values, usual = _colors_on(layer, camera, points.mean(0) - eyes)
    alpha = harmonics_on(layer[torch.from_numpy(plane.on(layer.means.numpy()))], camera)[1]
    revealed, through, unhidden, covered = testify(points, plane.heights(eyes), views, plane.band)
    through, seen = (gaussian_filter(x.reshape(alpha.shape), EDGE) for x in (through, unhidden))
    all_ = gaussian_filter(np.maximum(unhidden, 1).reshape(alpha.shape), EDGE)
    solid = through <= SEEN_THROUGH * all_
    witnessed = seen - through > WITNESSES * revealed.reshape(alpha.shape)
    known = (alpha > COVERED) | (solid & (alpha > THIN_LAYER) & witnessed)
    known, solid = _in_front(known, solid, seen > SEEN, points, others)
    shown = revealed + unhidden > OPEN * covered
    hidden, unseen = (((revealed > n * unhidden) & shown).reshape(known.shape) for n in HIDDEN)
    empty = Sheet(camera, 1 / camera.fx, values, known, hidden, hidden, depth, usual)
    close = np.abs(plane.heights(thing.points)) < CLOSE * thing.extent
    caster = empty.under(thing.points[close])
    glossy = _glossy(known, solid, caster, unseen)
    if glossy.any():
        return replace(empty, known=known & ~glossy, caster=caster, hole=glossy, glossy=True)
    if caster.any():  # what it stands on is hidden from its foot on
        unseen = touching(unseen & solid, widened(caster, 2))
    hidden &= away_from(unseen) < NEARBY * thing.extent * camera.fx
    known |= closed(known, GAP) & solid & ~hidden
    known, hole = _holes(known, hidden & solid, unseen, least)
    whole = closed(hole | known, max(1, round(NOTCH * thing.extent * camera.fx)))
    if caster.any():
        hole = touching(hole, widened(caster, 2))
    hole |= whole & caster & ~known
    return replace(empty, known=known, caster=caster, hole=hole)


def _in_front(
    known: Bool[np.ndarray, "h w"],
    solid: Bool[np.ndarray, "h w"],
    seen: Bool[np.ndarray, "h w"],
    points: Float64[np.ndarray, "c 3"],
    others: Sequence[Plane],
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Known and solid pixels of a plane: behind another plane, only what was seen."""
    for other in others:
        behind = (other.heights(points) < -other.band).reshape(known.shape)
        known = known & (~behind | seen)
        if (known & behind).sum() <= BEHIND * known.sum():
            solid = solid & ~behind
    return known, solid


def _colors_on(
    layer: Gaussians, camera: Camera, ways: Float64[np.ndarray, "v 3"]
) -> tuple[Float[np.ndarray, "h w k3"], Float64[np.ndarray, " k"]]:
    """Harmonics, even, the first as the mean color that is seen along some ways; and the factors of
    the harmonics in that color, over SH_DC."""
    values, alpha = harmonics_on(layer, camera)
    towards = torch.nn.functional.normalize(torch.from_numpy(ways), dim=1)
    usual = basis(towards, layer.degree).mean(0).numpy() / SH_DC
    bands = values.reshape(*alpha.shape, -1, 3)
    values[..., :3] = 0.5 + SH_DC * np.einsum("hwkc,k->hwc", bands, usual)
    return _even(values, alpha), usual


def _glossy(
    known: Bool[np.ndarray, "h w"],
    solid: Bool[np.ndarray, "h w"],
    caster: Bool[np.ndarray, "h w"],
    unseen: Bool[np.ndarray, "h w"],
) -> Bool[np.ndarray, "h w"]:
    """The part amid a surface that an object stands on though views see through it: as nothing
    stands in the air, it reflects. Empty if there is none."""
    foot = caster | touching(unseen & ~known, caster)
    clear = touching(~solid & ~known, widened(foot, GAP))
    part = opened(clear | foot)
    beyond = clear[[0, -1]].any() or clear[:, [0, -1]].any()
    if beyond or not part.any() or not caster.sum() < clear.sum() < AMID * known.sum():
        return np.zeros_like(part)
    hull = Delaunay(np.argwhere(part)).find_simplex(np.argwhere(np.ones_like(part))) >= 0
    hull = hull.reshape(part.shape)
    stands = (hull & caster).sum() > MOST_OF * caster.sum()
    return hull & (stands and part.sum() > MOST_OF * hull.sum())


def _holes(
    known: Bool[np.ndarray, "h w"],
    hidden: Bool[np.ndarray, "h w"],
    unseen: Bool[np.ndarray, "h w"],
    least: int,
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """(what is known, without thin remains of the object; the holes in it)."""
    hole = enclosing(hidden | known) & ~known
    open_ = hole & ~_surrounded(hole, known, unseen, least)
    hole = _surrounded(hole & ~(open_ & ~_ending(known, open_)), known, unseen, least)
    for loose in (~_wide(known, hole), ~opened(known)):
        remains = known & closed(hole, NEAR_HOLE) & loose
        known, hole = known & ~remains, hole | remains
    hole = opened(hole) | (hole & enclosing(known))
    return known, hole


def standing(
    sheet: Sheet, plane: Plane, points: Float[np.ndarray, "n 3"], extent: float
) -> Bool[np.ndarray, "h w"]:
    """The cells that something of these points, no mere roughness, stands on or hangs close over.

    `extent` is the object's.
    """
    heights = plane.heights(points)
    return sheet.under(points[(heights > plane.band) & (heights < plane.band + CLOSE * extent)])


def _even(
    values: Float[np.ndarray, "h w c"], alpha: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w c"]:
    """Values in which thin cells take those of their neighbors, by opacity."""
    share = alpha.clip(0, 1)[..., None]
    return share * values + (1 - share) * mean_around(values, alpha, 1.0)


def _frame(rough: Sheet, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows, from and to, of the hole and of what is known around it."""
    asked = rough.hole | (rough.caster & rough.known)
    numbers, _ = parts_of(asked)
    sizes = np.bincount(numbers[asked])
    asked = asked & (sizes >= SPECK * sizes.max())[numbers]
    rows, columns = np.nonzero(asked)
    size = max(np.ptp(rows), np.ptp(columns)) + 1
    margin = max(SURROUNDINGS * size, NEIGHBORHOOD * extent / rough.cell)
    near = away_from(asked) < 3 + margin
    around = touching(rough.known & near, widened(asked, 2))
    rows, columns = np.nonzero(asked | around)
    low = np.array((columns.min(), rows.min()), float) - 2
    return low, np.array((columns.max(), rows.max()), float) + 3


def _wide(known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """The connected parts of what is known that are no islands in the hole."""
    numbers, _ = parts_of(known)
    sizes = np.bincount(numbers.reshape(-1))
    return known & (sizes >= ISLAND**2 * hole.sum())[numbers]


def _ending(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """The rectangle around the known part that a hole is at the edge of; empty if it is none."""
    core = touching(opened(known), widened(hole, 2 + GAP))
    inside = rectangle_around(core)
    rest = inside & ~hole
    return inside & ((known & rest).sum() >= FULL * rest.sum())


def _surrounded(
    hole: Bool[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    hidden: Bool[np.ndarray, "h w"],
    least: int,
) -> Bool[np.ndarray, "h w"]:
    """The connected holes that are large enough, the object's, and bordered by what is known."""
    numbers, count = parts_of(hole)
    sizes = np.bincount(numbers.reshape(-1), minlength=count + 1)
    grown = np.asarray(grey_dilation(numbers, 5))
    rim = (grown > 0) & (numbers == 0)
    around = np.bincount(grown[rim], minlength=count + 1)
    bordered = np.bincount(grown[rim & known], minlength=count + 1)
    own = np.bincount(numbers[hidden], minlength=count + 1)
    kept = (sizes >= least) & (bordered >= BORDERED * around) & (own >= OWN * sizes)
    kept[0] = False
    return kept[numbers]


SHADOW_REACH = 0.7
"""Farthest that a shadow reaches from what casts it, of its size."""
CONTACT = 0.35
"""Farthest that a shadow reaches where little is touched, of the farthest that is asked."""
NEAREST = 0.65
"""Largest share of what is known that is asked for a shadow: the rest says what is usual."""
SHADED = 0.94
"""Light, of what is usual, below which there is shadow."""
DIM, USUAL = 0.85, 0.6
"""Light beside it that is surely dim, of the quantile of all light that is usual."""
WIDE = (4.0, 0.15)
"""Standard deviation over which light is averaged for that, at least in cells, and of the size of
what casts it: wider than a texture's own dark parts."""
DEEP = 0.7
"""Light, of what is usual, below which nothing of the surface can be brought back."""
THIN = 0.08
"""Half of the width, of the size of what casts it, up to which what is dark is no shadow: a crease
between two surfaces, or a bridge to another's shadow."""
CLOSER = 2.0
"""How much nearer than the object what else stands there is to what is in its own shadow."""
TOUCHED = 0.04
"""Distance from it, of the farthest that is asked, in which what is dim is what is left of it."""
BLUR = 0.1
"""Standard deviation over which light is averaged, of the size of what casts it."""
GRAY = 1.2
"""Largest ratio of the light of two colors in a shadow that ends sharply: else it is paint."""
SOFT = 0.82
"""Light at the border of a shadow, of what is usual, from which it fades out."""
FADES = 0.05
"""Least difference in light of its farthest and nearest quarters, then: else it is the ground's."""
PATTERN = 4.0
"""Least standard deviation of the blur that leaves the light of a surface, cells: a pattern of its
own, as a floor's tiles, is no light."""


def find_shade(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    caster: Bool[np.ndarray, "h w"],
    others: Bool[np.ndarray, "h w"],
    farthest: float,
) -> tuple[Float[np.ndarray, "h w 1"], Bool[np.ndarray, "h w"]]:
    """The shadow around what casts it, on what is known of a surface; `farthest` cells from it.

    (light that is left of what is usual, in (0, 1], 1 where there is no shadow; cells that are too
    dark for anything to be brought back, or are remains of what stood there).

    What is nearer to `others`, that stand there too, is in their shadow.
    """
    none, source = (np.ones((*hole.shape, 1)), np.zeros_like(hole)), hole | caster
    if not caster.any() or not (known & ~source).any():
        return none
    size = float(np.sqrt(source.sum()))
    away = away_from(source)
    reach, thin = max(SHADOW_REACH * size, CONTACT * farthest), max(1, round(THIN * size))
    reach = min(reach, float(np.quantile(away[known], NEAREST)))
    sigma, seen = max(1.0, BLUR * size), known.astype(np.float64)
    mean = mean_around(picture, seen, sigma)
    near = known & (away <= reach)
    wide = mean_around(picture, seen, max(WIDE[0], WIDE[1] * size)).mean(-1)
    dim = wide < DIM * np.quantile(wide[known], USUAL)
    near = closed(near | touching(known & dim & (away <= farthest), source | near), thin) & ~hole
    far = known & ~near
    if not near.any() or not far.any():
        return none
    even = mean_around(picture, far.astype(float), sigma)
    usual = np.maximum(solve_membrane(even, hole | near, far), 1e-3)
    light, own = mean / usual, (mean_around(picture, seen, 1.0) / usual).mean(-1)
    contact = known & (away <= TOUCHED * farthest) & (own < DIM)
    dark = near & (light.mean(-1) < SHADED)
    dark &= opened(dark | source, thin)
    if others.any():
        dark &= CLOSER * away_from(others) > away
    shadow = _shadows(light, touching(dark, source), known, away)
    if not shadow.any():
        return none[0], contact
    even = mean_around(picture, seen, max(PATTERN, sigma)).mean(-1) / usual.mean(-1)
    fading = np.where(shadow, even.clip(0.05, 1.0), 1.0)[..., None]
    fading = mean_around(fading, seen, max(1.0, sigma / 2)).clip(0.05, 1.0)
    contact |= shadow & (fading[..., 0] < DEEP)
    return np.where(known[..., None], fading, 1.0), contact


def _shadows(
    light: Float[np.ndarray, "h w 3"],
    dark: Bool[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    away: Float64[np.ndarray, "h w"],
) -> Bool[np.ndarray, "h w"]:
    """The connected parts of what is dark that are shadows, each by itself."""
    numbers, count = parts_of(dark)
    parts = [numbers == part for part in range(1, count + 1)]
    cast = (part for part in parts if _cast(light, part, known & ~dark, away))
    return np.any([np.zeros_like(dark), *cast], 0)


def _cast(
    light: Float[np.ndarray, "h w 3"],
    shadow: Bool[np.ndarray, "h w"],
    lit: Bool[np.ndarray, "h w"],
    away: Float64[np.ndarray, "h w"],
) -> bool:
    """Whether what is dark is a shadow: it fades out away from what casts it, or ends sharply and
    takes all colors alike."""
    rim = shadow & widened(lit, 2)
    if not rim.any() or np.median(light[rim].mean(-1)) > SOFT:
        near, far = np.quantile(away[shadow], (0.25, 0.75))
        first, last = (np.median(light[shadow & at].mean(-1)) for at in (away <= near, away >= far))
        return bool(first < last - FADES)
    channels = np.median(light[shadow], 0)
    return bool(channels.max() < GRAY * channels.min())
