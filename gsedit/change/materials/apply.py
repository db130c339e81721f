"""A part of a scene in a material: its Gaussians get the colors that it has in the scene's light.

Nothing moves, and nothing else changes: colors agree between views since they are the Gaussians'.
What is carved stays under the new material, and paint goes. A Gaussian that is darker than those
around it lies in a carved line, or is painted so: it counts as carved as far as its hue is that of
its surroundings, and surely where the surface is hollow.
`n` Gaussians, `m` of them inside the part, `v` directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.change.materials.material import Material
from gsedit.change.materials.shading import (
    RAYS,
    Ground,
    Lighting,
    Skin,
    arriving,
    body,
    coverage,
    everywhere,
    lighting,
    opacity_of,
    outgoing,
    ray_directions,
    reflectance,
)
from gsedit.errors import UsageError
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.color_space import LUMINANCE, linear_of_srgb, srgb_of_linear
from gsedit.scene.framing import ends, guess_up
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.outcome import Outcome
from gsedit.scene.quaternions import turn_between
from gsedit.select.region import lift
from gsedit.toolkit.grade import GAMMA
from gsedit.views.dataset import evenly_spaced
from gsedit.views.discs import Discs, discs_on
from gsedit.views.normals import (
    all_around,
    estimate_normals,
    neighbor_means,
    rows_near,
    smoothed,
    visible_area,
)
from gsedit.views.paths import up_of
from gsedit.views.shadows import past_body
from gsedit.views.surroundings import (
    FAINT,
    USUAL_ALBEDO,
    Surroundings,
    as_shaded,
    balanced,
    contrasted,
    find_surroundings,
    light_at,
    middle,
    with_studio,
)
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.harmonics import basis
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians, concatenate

ROUNDS = 12
"""Means over the nearest neighbors, one after the other: the surroundings of a Gaussian."""
HUE = 0.12
"""Difference in the share of a channel at which a color is half paint."""
SPARSE = 6
"""Discs for one of which light that arrives is computed: it changes slowly."""
SHADED = 0.5
"""Share that darkness counts as hollow: paint and the grain of wood are dark, too."""
HOLLOW = 0.12
"""Mean sine at which neighbors stand above a surface that is fully hollow."""


@dataclass(frozen=True, eq=False)
class Few:
    """Some of the Gaussians of a part, for what changes slowly over its surface."""

    rows: Int[Tensor, " k"]
    over: Int[Tensor, "n j"]
    """The nearest of the few to each Gaussian: rows of `rows`."""
    near: Int[Tensor, "k i"]
    """The nearest of the few to each of them."""

    def gathered(self, values: Float[Tensor, "n ..."]) -> Float[Tensor, "k ..."]:
        """Sums over the Gaussians that each of the few stands for."""
        return values.new_zeros(len(self.rows), *values.shape[1:]).index_add(
            0, self.over[:, 0], values
        )

    def spread(self, values: Float[Tensor, "k ..."]) -> Float[Tensor, "n ..."]:
        """Means over the nearest of the few."""
        return values[self.over].mean(1)


def few_of(part: Gaussians, discs: int, near: Int[Tensor, "n i"]) -> Few:
    """One in SPARSE of a part's last Gaussians, which are `discs`, and all others."""
    left = len(part) - discs
    rows = torch.cat((torch.arange(left), torch.arange(left, len(part), SPARSE)))
    if not discs:
        return Few(rows, rows[:, None], near)
    _, over = k_nearest(part.means[rows].numpy(), part.means.numpy(), min(3, len(rows)))
    return Few(rows, torch.from_numpy(over), rows_near(part.means[rows]))


def carved(
    part: Gaussians, normals: Float[Tensor, "m 3"], fine: Float[Tensor, " m"], few: Few
) -> tuple[Float[Tensor, " m"], Float[Tensor, "m 3"]]:
    """How hollow or carved a subject is at its Gaussians, in [0, 1], as these normals and detail
    tell; and the linear color of the surroundings of each on the surface."""
    around = colors_around(part, few)[1]
    if not few.near.shape[1]:
        return part.means.new_zeros(len(part)), around
    points = part.means[few.rows]
    offset = torch.nn.functional.normalize(points[few.near] - points[:, None], dim=-1)
    rise = (offset * normals[few.rows, None]).sum(-1).mean(1)
    hollow = few.spread(neighbor_means(rise, few.near, 2) / HOLLOW)
    return torch.maximum(hollow, SHADED * (1 - fine)).clamp(0, 1), around


def colors_around(part: Gaussians, few: Few) -> tuple[Tensor, Tensor, Tensor]:
    """Linear colors, the mean of those around each on the surface, and what weighs each."""
    display = sh_to_color(part.sh[:, 0]).clamp(0, 1).double().numpy()
    linear = torch.from_numpy(linear_of_srgb(display)).to(part.means) + 1e-3
    size = visible_area(part).clamp_min(1e-30).to(linear)
    sized = torch.cat((linear, torch.ones_like(linear[:, :1])), 1) * size[:, None]
    around = few.spread(neighbor_means(few.gathered(sized), few.near, ROUNDS))
    return linear, around[:, :3] / around[:, 3:], size


DETAIL_VIEWS, DETAIL_PIXELS = 16, 512
"""Most views that detail is seen in, and their longer side."""
AROUND = 0.06
"""Standard deviation of what counts as around, in radii of the part."""
SOLID = 0.9
"""Share of its fullest pixel from which a part's color is told there: haze may veil it all."""
FINE, STEEPER, QUIET = (0.15, 2.0), (1.2, 2.4), (-0.05, -4.0)
"""Least and largest ratio to what is around; its powers on Gaussians and on discs, which blur it;
its logarithm at which these begin to show it, and how fast: grain goes, joints stay."""
COLORED = 0.58
"""Mean size of that logarithm between neighbors from which a face or slats are color, not shape: a
part's own Gaussians show it. Granite has 0.5, a weathered table 0.65, carved wood 0.9."""
BESIDE = 3
"""Discs whose mean color a Gaussian in their place gets."""
AGREED, SHARP = 0.75, 1.2
"""Length of the mean normal below which discs melt a part, if its Gaussians have fewer cells."""
RIDGE = (0.0, 1e-3, 2e-3, 4e-3)
"""Penalty of the squared coefficients of each degree, against the squared error of colors."""


def fitted(
    colors: Float[Tensor, "n v 3"],
    directions: Float[Tensor, "v 3"],
    weights: Float[Tensor, "n v"],
    degree: int,
) -> Float[Tensor, "n k 3"]:
    """Coefficients with the least weighted squared error to display colors less 0.5.

    `directions` are unit vectors from cameras to Gaussians. Weights need not sum to 1; a row of
    zeros has coefficients of zero.
    """
    harmonics = basis(directions, degree)
    k = harmonics.shape[1]
    share = weights / weights.sum(1, keepdim=True).clamp_min(1e-9)
    products = (harmonics[:, :, None] * harmonics[:, None]).reshape(len(directions), k * k)
    penalty = torch.tensor([RIDGE[band] for band in range(degree + 1) for _ in range(2 * band + 1)])
    matrix = (share @ products).reshape(-1, k, k) + torch.diag(penalty.to(share) + 1e-6)
    right = torch.einsum("nv,vk,nvc->nkc", share, harmonics, colors - 0.5)
    return torch.cholesky_solve(right, torch.linalg.cholesky(matrix))


DEGREE = 3
"""SH degree of what reflects."""
CAMERAS = 40
"""Most cameras whose directions colors are fitted to."""
BEHIND = 0.1
"""Sine beyond the horizon up to which a surface is seen: its Gaussians are not flat."""
SHARPNESS = 10.0
"""Sharpness of a camera's weight over directions: half at 21 degrees."""
AROUND_WEIGHT = 0.05
"""Weight of directions without cameras, against the mean one."""
WHITENED = 0.6
"""Share of white in light that is much too bright for a display."""
HANGS = 1.4
"""Height of lamps over a part, in its radii: far ones would light a flat top alike."""
UNSURE = 0.5
"""Median confidence of normals below which Gaussians show no surface."""
NEAR_EYES = 0.02
"""Distance, in radii of a part that cameras stand in, up to which it is not its surroundings."""
LEVELS = (0.1, 1.6)
"""Least and largest light on such a part, as its old colors tell it."""
STUDIO = "nothing is around it: it is lit by a studio"
DIM = "what lit it is not in the scene, such as a sky: a studio lights it where nothing is"
MIXED = "what is around it gives few highlights: key lights and a dark floor are mixed in"
RAISED = "reflections need SH of degree 3: the scene had {}, and its file grows"
SHOWN_EVERY = 3
"""One in so many directions is enough for one picture: on the bear 36 dB of glass, 42 of bronze."""
AT_ONCE = 1024
"""Gaussians that are shaded at once: 4 million pairs of cameras and directions, 16 MB."""


@dataclass(frozen=True, eq=False)
class Studied:
    """Knowledge of a part of a scene that shading it in any material needs."""

    laid: Laid
    fine: Float[Tensor, " q"]
    """Factor on display colors of each Gaussian inside, then of each disc: what is finer."""
    ragged: Bool[Tensor, " m"]
    """Whether the part's own Gaussians show it better there than discs."""
    few: Few
    light: Lighting
    skin: Skin
    ground: Ground
    sides: Float[Tensor, "m 2 3"]
    """Light that arrives in front of and behind each Gaussian, of a grey subject."""
    looked: Float[Tensor, "k d"]
    """How much the few are looked at from each direction; none of a matte part."""
    sure: float
    """Median confidence of the normals."""
    notes: tuple[str, ...] = ()
    """Remarks for a person."""


@torch.no_grad()
def in_material(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    material: Material,
    cameras: Sequence[Camera] = (),
    weights: Float[Tensor, " n"] | None = None,
    shown: Bool[Tensor, " n"] | None = None,
    *,
    discs: bool = True,
) -> Outcome:
    """The scene with the Gaussians inside in a material; the coefficients of others are the same.
    `discs`: whether some are laid where they show the material better.

    A material that reflects raises the scene's SH to degree 3, with zeros for what is outside; of
    it, only the Gaussians that are `shown` (None: all) are shaded, as for one picture.
    Raises UsageError for no Gaussians inside, or for ones that show no surface.
    """
    if not inside.any():
        raise UsageError("the material would be on no Gaussian: name what should be in it")
    fresh = discs and not material.is_plain
    studied = study(scene, inside, cameras, weights, material.is_matte and not fresh, fresh)
    if studied.sure < UNSURE and not material.is_matte:
        raise UsageError(
            "the part's Gaussians show no surface that could reflect (they are needles or fog): "
            "clean the scene first with gsedit clean"
        )
    laid, fine = shown_by(scene, inside, studied, material)
    degree, every = 0 if material.is_matte else DEGREE, 1
    sh = laid.scene.with_degree(max(scene.degree, degree)).sh
    rows, over = laid.inside.nonzero().squeeze(-1), laid.over
    if shown is not None and not (shown.all() or material.is_matte):
        every = SHOWN_EVERY
        some = torch.ones(len(rows)) > 0 if material.transmission else shown[laid.origin[rows]]
        rows, over, fine = (each[some] for each in (rows, over, fine))
    colored, bare = _worn(studied, material, degree, (over, fine), every)
    sh[rows] *= bare[:, None, None].to(sh)
    sh[rows, : colored.shape[1]] += ((1 - bare)[:, None, None] * colored).to(sh)
    told = [note for note in studied.notes if note != MIXED or not material.is_matte]
    told += [RAISED.format(scene.degree)] * (sh.shape[1] > scene.sh.shape[1])
    logits = laid.scene.logit_opacities.clone()
    logits[len(logits) - laid.count :] = float(torch.logit(torch.tensor(opacity_of(material))))
    made = replace(laid.scene, sh=sh, logit_opacities=logits)
    return Outcome(made, laid.origin, laid.inside, tuple(told))


def shown_by(
    scene: Gaussians, inside: Bool[Tensor, " n"], studied: Studied, material: Material
) -> tuple[Laid, Float[Tensor, " s"]]:
    """The scene with what shows a part in a material, and the detail of it: discs, but the part's
    own Gaussians where it is thin or ragged, if no light comes through."""
    old, own = studied.laid, studied.ragged.clone()
    fine = studied.fine if material.color else torch.ones_like(studied.fine)  # it is in its colors
    first = len(own) - old.count
    own[first:] &= material.transmission == 0
    mine, true, kept = own[old.over].any(1), ~own[first:], torch.ones_like(inside)
    kept[inside] = mine
    discs = torch.arange(first, len(own))[true, None].expand(-1, old.over.shape[1])
    start, over = len(old.scene) - old.count, torch.cat((old.over[mine], discs))
    laid = _laid(scene, inside, kept, (old.scene[start:][true], old.origin[start:][true]), over)
    return laid, fine[torch.cat((mine, true))]


def _worn(
    studied: Studied, material: Material, degree: int, at: tuple[Tensor, Tensor], every: int
) -> tuple[Float[Tensor, "s k 3"], Float[Tensor, " s"]]:
    """SH coefficients of Gaussians in a material, and how bare of it they are; `at`: `over` and
    `fine` of `Studied`, theirs."""
    (over, fine), ground = at, studied.ground
    used, place = over.unique(return_inverse=True)
    colored = colors_of(studied, material, degree, used, every)
    colored = colored[place].mean(1) * fine[:, None, None]
    colored[:, 0] += 0.5 * (fine[:, None] - 1) / SH_DC
    return colored, 1 - coverage(material.clings, ground)[over].mean(1)


@cached_per_scene
def study(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    cameras: Sequence[Camera] = (),
    weights: Float[Tensor, " n"] | None = None,
    matte: bool = False,
    fresh: bool = False,
) -> Studied:
    """Surface, surroundings, shadows and carving of the Gaussians inside, under `fresh` discs where
    they have a surface; for a `matte` material without what only reflections need: under discs it
    is the same for all materials, and known where another was looked at."""
    up = up_of(cameras) if len(cameras) > 1 else guess_up(scene)
    eyes = _eyes_within(scene[inside], cameras)
    discs = discs_on(scene[inside], cameras) if fresh and eyes is None else None
    laid = laid_on(scene, inside, discs)
    part = laid.scene[laid.inside]
    own, spread = own_detail(scene[inside])
    fine = torch.cat((own, seen_detail(scene, inside, cameras, laid)))
    near = rows_near(part.means)
    few = few_of(part, laid.count, near)
    directions, confidence = _normals(scene, inside, cameras, discs, near)
    ragged = ragged_at(scene, laid, directions, few, discs.cell if discs else 0.0)
    ragged |= spread > COLORED
    center, radius = middle(scene, inside)
    if laid.count:  # without the waves of a few discs' length; edges stay sharp
        coarse = few.spread(smoothed(directions[few.rows], few.near).directions)
        directions = smoothed(coarse, near).directions
    worn = fine[torch.cat((laid.over[:, 0] < len(part) - laid.count, torch.ones(laid.count) > 0))]
    hollow, color = carved(part, directions, worn, few)
    ground = _ground(part, directions, hollow, up, (center, radius))
    sure = float(confidence.median())
    looked = looked_from(part.means[few.rows[:0] if matte else few.rows], cameras)
    if eyes is not None:
        around = balanced(light_at(scene, eyes, NEAR_EYES * radius, up, cameras=cameras))
        light = lighting(around, None if matte else around)
        skin = Skin(part.means, directions, torch.ones(1, RAYS), torch.zeros(len(part)).long())
        old = color @ torch.from_numpy(LUMINANCE).to(color)
        level = (old / USUAL_ALBEDO).clamp(*LEVELS)[:, None, None].expand(-1, 2, 3)
        return Studied(laid, fine, ragged, few, light, skin, ground, level, looked, sure, ())
    some, flat = part[few.rows], directions[few.rows]
    open_ = past_body(some, some.means, ray_directions().double(), normals=flat).to(directions)
    bare = Skin(some.means, flat, open_, torch.arange(len(some)))
    weight = visible_area(some) if weights is None or discs is not None else weights[inside]
    around = find_surroundings(scene, inside, up, cameras=cameras)
    light, notes = _light(around, up, radius, color[few.rows], bare.share, weight, matte)
    chunks = torch.arange(len(some)).split(AT_ONCE)
    sides = torch.cat([arriving(light, bare[rows]) for rows in chunks])
    skin = Skin(part.means, directions, few.spread(open_), torch.arange(len(part)))
    return Studied(
        laid, fine, ragged, few, light, skin, ground, few.spread(sides), looked, sure, notes
    )


def _ground(
    part: Gaussians,
    normals: Float[Tensor, "m 3"],
    hollow: Float[Tensor, " m"],
    up: Float[Tensor, "3"],
    ball: tuple[Tensor, float],
) -> Ground:
    """Ground of patterns: the part around the middle of its ball, upright."""
    turn = torch.from_numpy(turn_between(up.numpy(), np.array((0.0, 0.0, 1.0)))).to(part.means).T
    center, radius = ball
    return Ground((part.means - center) @ turn / max(radius, FAINT), normals @ turn, hollow)


def _light(
    around: Surroundings,
    up: Float[Tensor, "3"],
    radius: float,
    color: Float[Tensor, "k 3"],
    share: Float[Tensor, "k d"],
    weight: Float[Tensor, " k"],
    matte: bool,
) -> tuple[Lighting, tuple[str, ...]]:
    """Light on a part that shows these colors, and what was added to it, in words."""
    notes = [STUDIO] if around.studio else []
    if not around.studio:
        lit = as_shaded(around, color, share, weight.to(share), ray_directions().to(share))
        notes += [DIM] if lit is None else []
        around = with_studio(around, up) if lit is None else lit
    around = balanced(around)
    if matte:
        return lighting(around), tuple(notes)
    mirrored, mixed = contrasted(around, up, HANGS * radius)
    notes += [MIXED] if mixed and not around.studio else []
    return lighting(around, mirrored), tuple(notes)


@dataclass(frozen=True, eq=False)
class Laid:
    """A scene whose part has discs on it, its last Gaussians."""

    scene: Gaussians
    inside: Bool[Tensor, " m"]
    origin: Int[Tensor, " m"]
    """Row in the scene before: of a disc the nearest one's of the part."""
    count: int
    """Number of discs among its Gaussians, which are its last ones."""
    over: Int[Tensor, "p j"]
    """Rows of this part whose mean color each Gaussian of the part before gets: those of discs in
    its place, or its own."""


def laid_on(scene: Gaussians, inside: Bool[Tensor, " n"], discs: Discs | None) -> Laid:
    """The scene with discs in place of the Gaussians that they cover."""
    rows, kept = inside.nonzero().squeeze(-1), torch.ones_like(inside)
    if discs is None:
        return _laid(scene, inside, kept, (scene[:0], rows[:0]), torch.arange(len(rows))[:, None])
    kept[rows[discs.covered]] = False
    fresh = discs.scene.with_degree(scene.degree)
    over = (kept[rows].cumsum(0) - 1)[:, None].repeat(1, min(BESIDE, len(fresh)))
    lost = scene.means[rows[discs.covered]].numpy()
    near = k_nearest(fresh.means.numpy(), lost, over.shape[1])[1]
    over[discs.covered] = torch.from_numpy(near) + int(kept[rows].sum())
    return _laid(scene, inside, kept, (fresh, rows[discs.origin]), over)


def _laid(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    kept: Bool[Tensor, " n"],
    discs: tuple[Gaussians, Int[Tensor, " d"]],
    over: Int[Tensor, "p j"],
) -> Laid:
    """A scene's kept Gaussians and the discs on them, with the rows that they come from."""
    (fresh, origin), ones = discs, torch.ones(len(discs[0]), dtype=torch.bool)
    origin = torch.cat((kept.nonzero().squeeze(-1), origin))
    made = concatenate(scene[kept], fresh)
    return Laid(made, torch.cat((inside[kept], ones)), origin, len(fresh), over)


def ragged_at(
    scene: Gaussians, laid: Laid, normals: Float[Tensor, "m 3"], few: Few, cell: float
) -> Bool[Tensor, " m"]:
    """Whether a part of fine Gaussians turns too fast for discs, as petals do, or has none."""
    wide = scene.log_scales[laid.origin[laid.inside]].sort(-1).values[:, 1:].mean(-1, keepdim=True)
    near = neighbor_means(torch.cat((normals, wide.exp()), 1)[few.rows], few.near, ROUNDS)
    agreed, wide = few.spread(near[:, :3].norm(dim=1)), few.spread(near[:, 3])
    no_disc = torch.arange(len(wide)) < len(wide) - laid.count
    return no_disc | ((agreed < AGREED) & (wide < SHARP * cell))


def own_detail(part: Gaussians) -> tuple[Float[Tensor, " m"], float]:
    """Factor on display colors of each Gaussian: its color against those around it; and how large
    its logarithm is in the mean."""
    light, soft, size = colors_around(part, few_of(part, 0, rows_near(part.means)))
    found = torch.from_numpy(detail(light.double().numpy(), soft.double().numpy())).to(size)
    return (STEEPER[0] * found / GAMMA).exp(), float(found.abs() @ size / size.sum())


def seen_detail(
    scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera], laid: Laid
) -> Float[Tensor, " d"]:
    """Factor on display colors of each disc: what cameras see of it, in the mean, against what is
    around it. Joints are darker so."""
    from scipy.ndimage import gaussian_filter

    if not laid.count:
        return scene.means.new_ones(0)
    eyes = list(cameras) or all_around(scene[inside])
    some = [eyes[i].fitted(DETAIL_PIXELS) for i in evenly_spaced(len(eyes), DETAIL_VIEWS)]
    (center, radius), maps = middle(scene, inside), []
    flags = inside.to(scene.means)[:, None].expand(-1, 3).contiguous()
    for view in some:
        share = color_weights(scene, view).picture(flags)[..., :1].double().numpy()
        share = share / max(share.max(), 1e-6)
        light = linear_of_srgb(render_picture(scene, view).double().numpy()) + 1e-3
        size = AROUND * radius * view.fx / max(float((center - view.center).norm()), radius)
        soft, parts = (gaussian_filter(each, (size, size, 0)) for each in (light * share, share))
        soft = np.where(share > SOLID, soft / np.maximum(parts, 1e-6), light)
        maps.append(torch.from_numpy(detail(light, soft)).float())
    found = lift(laid.scene, some, maps).mean[-laid.count :]
    return (STEEPER[1] * found * (QUIET[1] * (found - QUIET[0])).clamp(0, 1) / GAMMA).exp()


def detail(light: np.ndarray, soft: np.ndarray) -> np.ndarray:
    """Logarithm of how much brighter linear colors are than those around them, of the same hue."""
    hue = np.abs(light / light.sum(-1, keepdims=True) - soft / soft.sum(-1, keepdims=True))
    ratio = np.clip(light @ LUMINANCE / (soft @ LUMINANCE), *FINE)
    return np.log(ratio) / (1 + (hue.max(-1) * np.minimum(ratio, 1) / HUE) ** 2)


def _normals(
    scene: Gaussians,
    inside: Bool[Tensor, " n"],
    cameras: Sequence[Camera],
    discs: Discs | None,
    near: Int[Tensor, "m k"],
) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """Normals of a part, and how sure they are: those of discs are."""
    if discs is None:
        found = estimate_normals(scene, cameras, inside=inside, near=near)
        return found.directions, found.confidence
    left = inside.clone()
    left[inside.nonzero()[discs.covered]] = False
    if not left.any():
        return discs.normals, torch.ones(len(discs.normals))
    found = estimate_normals(scene, cameras, inside=left)
    ones = torch.ones(len(discs.normals))
    return torch.cat((found.directions, discs.normals)), torch.cat((found.confidence, ones))


def _eyes_within(part: Gaussians, cameras: Sequence[Camera]) -> Float[Tensor, "3"] | None:
    """Middle of the cameras where most stand inside a part, as in a room: its surroundings are its
    own, and its old shading is all that is known of the light on it. None elsewhere."""
    if not cameras:
        return None
    eyes = torch.stack([camera.center for camera in cameras]).to(part.means)
    low, high = ends(part.means, 0.1)
    inside = ((eyes > low) & (eyes < high)).all(-1)
    return eyes.mean(0) if float(inside.float().mean()) > 0.5 else None


def colors_of(
    studied: Studied, material: Material, degree: int, only: Int[Tensor, " s"], every: int = 1
) -> Float[Tensor, "s k 3"]:
    """SH coefficients of these of the Gaussians in a material, fitted to one direction in many."""
    surface, skin = reflectance(material, studied.ground), studied.skin
    if not material.color:  # carving is in the colors that are there
        surface = replace(surface, color=own_colors(studied))
    diffuse = body(material, surface, studied.sides)
    if degree == 0:
        sent = everywhere(material, surface, diffuse, studied.sides[:, 0])
        return ((displayed(sent[only]) - 0.5) / SH_DC)[:, None]
    own = studied.sides[:, 0] * surface.color
    directions, looked = ray_directions()[::every].to(diffuse), studied.looked[:, ::every]
    found = [diffuse.new_zeros(0, (degree + 1) ** 2, 3)]
    for rows in only.split(AT_ONCE):
        some, here = skin[rows], surface[rows]
        seen = (some.normals @ directions.T + BEHIND).clamp(0, 0.5)
        weights = seen * looked[studied.few.over[rows, 0]]
        at, way = (weights > 0).nonzero().unbind(-1)
        sent = outgoing(
            studied.light, material, here[at], some[at], diffuse[rows][at], own[rows][at],
            directions[way], studied.laid.count > 0,
        )  # fmt: skip
        shown = sent.new_full((*weights.shape, 3), 0.5)
        shown[at, way] = displayed(sent)
        found.append(fitted(shown, -directions, weights, degree))
    return torch.cat(found)


def own_colors(studied: Studied) -> Float[Tensor, "m 3"]:
    """Albedo of what is there: its linear color by the light that arrives. What would be more than
    white is a highlight, and goes."""
    part = studied.laid.scene[studied.laid.inside]
    shown = linear_of_srgb(sh_to_color(part.sh[:, 0]).clamp(0, 1).double().numpy())
    sides = studied.sides[:, 0]
    return (torch.from_numpy(shown).to(sides) / sides.clamp_min(FAINT)).clamp(0, 1)


def displayed(light: Float[Tensor, "*s 3"]) -> Float[Tensor, "*s 3"]:
    """Display colors of linear light; what is too bright keeps its hue and turns half white, where
    clipped channels would turn gold to lemon."""
    most = light.amax(-1, keepdim=True).clamp_min(1)
    hue = (light / most).clamp_min(0)
    shown = hue + (1 - hue) * WHITENED * (1 - 1 / most)
    return torch.from_numpy(srgb_of_linear(shown.numpy())).to(light)


def looked_from(points: Float[Tensor, "k 3"], cameras: Sequence[Camera]) -> Float[Tensor, "k d"]:
    """How many of the cameras are near each of `ray_directions`, 1 in the mean, and a little more;
    1 without cameras."""
    directions = ray_directions().to(points)
    if not len(cameras):
        return points.new_ones(len(points), len(directions))
    some = [cameras[i].center for i in evenly_spaced(len(cameras), CAMERAS)]
    eyes, found = torch.stack(some).to(points), [points.new_zeros(0, len(directions))]
    for rows in torch.arange(len(points)).split(AT_ONCE):
        to_cameras = torch.nn.functional.normalize(eyes - points[rows, None], dim=-1)
        near = torch.exp(SHARPNESS * (to_cameras @ directions.T - 1)).mean(1)
        found.append(near / near.mean(1, keepdim=True) + AROUND_WEIGHT)
    return torch.cat(found)
