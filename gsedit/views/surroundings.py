"""Light that falls on a subject: its surroundings as a map of all directions, in linear light.

Six pictures from the middle of the subject, without it, make a map. Directions that nothing was
seen in are filled smoothly from those around them; light that pictures clip is estimated above 1;
where there is nothing at all, a photographer's studio stands in. The subject's old shading was made
by that light: it tells how bright it is where pictures are clipped or blind.

A map has `h w` cells by polar angle from +z and azimuth from +x; their centers lie at half steps,
rows go from +z down, columns once around. `n` Gaussians, `m` of them the subject's; `d` directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from gsedit.scene.color_space import LUMINANCE, linear_of_srgb
from gsedit.scene.framing import ends, guess_up, weighted_quantile
from rasterizer.camera import Camera, look_at
from rasterizer.render import render
from rasterizer.scene import Gaussians

FAINT = 1e-12
"""Weight below which a mean is 0 by 0."""


@lru_cache(8)
def cell_directions(height: int) -> Float[Tensor, "h w 3"]:
    """Unit vectors to the centers of the cells of a map with w = 2 h."""
    polar = (torch.arange(height) + 0.5) * (pi / height)
    azimuth = (torch.arange(2 * height) + 0.5) * (pi / height)
    ring, z = polar.sin()[:, None], polar.cos()[:, None].expand(-1, 2 * height)
    return torch.stack((ring * azimuth.cos(), ring * azimuth.sin(), z), -1)


@lru_cache(8)
def cell_areas(height: int) -> Float[Tensor, "h w"]:
    """Solid angles of the cells of a map with w = 2 h, steradians: they sum to 4 pi."""
    edges = (torch.arange(height + 1) * (pi / height)).cos()
    return ((edges[:-1] - edges[1:]) * (pi / height))[:, None].expand(-1, 2 * height).clone()


def cell_of(directions: Float[Tensor, "n 3"], height: int) -> Int[Tensor, " n"]:
    """The number, row by row, of the cell of a map with w = 2 h that a unit direction is in."""
    row = (torch.acos(directions[:, 2].clamp(-1, 1)) * (height / pi)).long().clamp_max(height - 1)
    turn = torch.atan2(directions[:, 1], directions[:, 0]) * (height / pi)
    return row * 2 * height + turn.floor().long() % (2 * height)


def look_up(
    values: Float[Tensor, "h w c"], directions: Float[Tensor, "*n 3"]
) -> Float[Tensor, "*n c"]:
    """A map at unit directions, bilinear between cells; constant beyond the rows at the poles."""
    h, w, channels = values.shape
    flat = directions.reshape(-1, 3)
    row = (torch.acos(flat[:, 2].clamp(-1, 1)) * (h / pi) - 0.5).clamp(0, h - 1)
    column = torch.atan2(flat[:, 1], flat[:, 0]) * (w / (2 * pi)) - 0.5
    top, left = row.floor().clamp_max(max(h - 2, 0)), column.floor()
    down, right = (row - top)[:, None], (column - left)[:, None]
    # once around is from -w / 2 to w / 2: remainders of integers would take half of the time
    lefts = torch.where(left < 0, left + w, left).int()
    rights = torch.where(lefts == w - 1, 0, lefts + 1)
    first = top.int() * w
    second = first + (w if h > 1 else 0)
    cells = values.reshape(h * w, channels)
    upper, lower = (
        torch.lerp(cells.index_select(0, row + lefts), cells.index_select(0, row + rights), right)
        for row in (first, second)
    )
    return torch.lerp(upper, lower, down).reshape(*directions.shape[:-1], channels)


def halved(values: Float[Tensor, "h w c"], height: int) -> Float[Tensor, "g v c"]:
    """The map with `height` rows, means by solid angle; its own number of rows is a multiple."""
    h, w, channels = values.shape
    step = h // height
    weighted = torch.cat((values, torch.ones_like(values[..., :1])), -1)
    weighted = weighted * cell_areas(h)[..., None].to(values)
    sums = weighted.reshape(height, step, w // step, step, channels + 1).sum((1, 3))
    return sums[..., :-1] / sums[..., -1:]


def filtered(
    values: Float[Tensor, "h w c"], kernel: Float[Tensor, "m m"], weights: Float[Tensor, "h w"]
) -> Float[Tensor, "h w c"]:
    """Means over all cells, by a kernel between cells and each cell's weight."""
    h, w, channels = values.shape
    by_cell = kernel * weights.reshape(1, -1)
    total = by_cell.sum(1, keepdim=True).clamp_min(FAINT)
    return ((by_cell @ values.reshape(h * w, channels)) / total).reshape(h, w, channels)


ROWS = 64
"""Rows of a map: cells of 2.8 degrees, as fine as SH of degree 3 on small Gaussians can show."""
COARSE = 32
"""Rows of a map that is filtered by kernels between all pairs of its cells."""
FACE_PIXELS = 64
"""Side of the six pictures."""
LEAST_SEEN = 0.05
"""Share of all directions below which there are no surroundings."""
FILL_POWER = 3.0
"""Power of the inverse squared angle that weighs what is seen where a hole is filled."""
FILL_ANGLE = 0.1
"""Angle, radians, below which all that is seen counts alike."""
OVERHEAD = (0.5, 0.95)
"""Sine of the elevation at which a sky that no camera saw begins, and where it is full."""
SKY = 2.5
"""Brightness of such a sky, or of a ceiling's lamps, against the mean of what was seen."""
CLIPPED = (0.8, 1.0)
"""Display values of the brightest channel between which light counts as clipped, from 0 to 1."""
CLIPPED_GAIN = 3.0
"""Factor of clipped light: a bright sky in a picture that is exposed for the ground."""
ROUGHNESSES = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0)
"""Roughness of the prefiltered maps; GGX's alpha is its square."""
LAMPS = ((1.0, 0.5, 0.7, 0.30, 5.0), (-1.0, 0.7, 0.5, 0.42, 2.0), (0.1, -1.0, 0.6, 0.25, 3.0))
"""Soft boxes of a studio, see `lamps`."""
KEYS = ((1.0, 0.6, 0.9, 0.35, 10.5), (-0.7, 0.9, 0.6, 0.3, 7.0), (-0.4, -1.0, 0.8, 0.35, 10.5),
        (0.05, 0.05, 1.0, 0.25, 6.0))  # fmt: skip
"""Key lights that are mixed into poor surroundings, against their mean: one for each side that one
may look from, and one for flat tops."""
DARK_FLOOR, HORIZON = 0.25, 0.05
"""Light of the floor then, against what it was, and the sine of the angle below which it is."""
PALER = 0.5
"""Share of the colors of surroundings that mirrors leave out: gold among trees is gold."""
MIXED = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Strengths that are tried."""
GLOSS = 0.3
"""Roughness of the metal that judges."""
DARK, BRIGHT = 0.2, 0.97
"""Shares of all directions below which light is dark, and above which it is a highlight."""
DARKEST, BRIGHTEST = 0.2, 5.0
"""Light there, at most and at least, against the mean."""
BALANCE = 0.8
"""Share of the light's color that white balance takes away."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Linear light from all directions around a point, 1 where a display is white."""

    center: Float[Tensor, "3"]
    """Middle of the subject, world units."""
    radiance: Float[Tensor, "h w 3"]
    """Light from each direction; above 1 where pictures are clipped."""
    distance: Float[Tensor, "h w"]
    """Distance of what is seen there, world units; inf where nothing is."""
    seen: Float[Tensor, "h w"]
    """Share of each direction that was seen, in [0, 1]; the rest is filled in."""
    studio: bool = False
    """Whether there are no surroundings, and a studio's lights stand in."""


@torch.no_grad()
def find_surroundings(
    scene: Gaussians,
    subject: Bool[Tensor, " n"],
    up: Float[Tensor, "3"] | None = None,
    cameras: Sequence[Camera] = (),
) -> Surroundings:
    """The surroundings of the subject's Gaussians, from the middle of them, without them.

    Directions that none of the cameras saw anything of are filled in: what a fit leaves there means
    nothing. Those above are as bright as skies and ceilings are against what stands below them.

    A studio, upright along `up` (guessed if None), where fewer than LEAST_SEEN of all directions
    show anything. The subject must not be empty.
    """
    center, radius = middle(scene, subject)
    near = 0.35 * radius  # its own remains are not surroundings
    return light_at(scene[~subject], center, near, guess_up(scene) if up is None else up, cameras)


@torch.no_grad()
def light_at(
    scene: Gaussians,
    center: Float[Tensor, "3"],
    near: float,
    up: Float[Tensor, "3"],
    cameras: Sequence[Camera] = (),
) -> Surroundings:
    """The light of a scene around a place, see `find_surroundings`; nothing nearer than `near`,
    world units, is seen."""
    if not len(scene):
        return studio(center, up)
    color, alpha, distance = panorama(scene, center, near)
    display = color / alpha.clamp_min(FAINT)[..., None]
    alpha = alpha * in_sight(center, distance, cameras)
    if float((alpha * cell_areas(ROWS)).sum()) < LEAST_SEEN * 4 * pi:
        return studio(center, up)
    seen = filled(unclipped(display), alpha, up)
    known = torch.where(alpha > 0.5, distance, torch.inf)
    return Surroundings(center, seen, known, alpha)


def middle(scene: Gaussians, subject: Bool[Tensor, " n"]) -> tuple[Float[Tensor, "3"], float]:
    """Middle of the subject's bulk, and the distance within which nine tenths of it lie."""
    means = scene.means[subject]
    low, high = ends(means, 0.03)
    center = (low + high) / 2
    away = (means - center).norm(dim=-1)[:, None]
    return center, float(ends(away, 0.1)[1, 0])


def panorama(
    scene: Gaussians, center: Float[Tensor, "3"], near: float
) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Display color, blended over black, alpha, and distance in world units of all directions.

    Six pictures of 90 degrees; colors without dependence on the direction, which is known only
    towards the cameras. Nothing nearer than `near` is shown.
    """
    plain = replace(scene, sh=scene.sh[:, :1])
    directions = cell_directions(ROWS).to(scene.means)
    found = directions.new_zeros((*directions.shape[:2], 5))
    for axis in torch.eye(3, dtype=torch.float64):
        for forward in (axis, -axis):
            up = axis.roll(1)
            eye = center.double()
            camera = look_at(eye, eye + forward, up, 90.0, FACE_PIXELS, FACE_PIXELS)
            camera = replace(camera, near=max(near, 1e-9))
            drawn = render(plain, camera, median_depth=True)
            assert drawn.median_depth is not None
            maps = torch.cat(
                (drawn.color, drawn.alpha[..., None], drawn.median_depth[..., None]), -1
            )
            here = directions @ forward.to(directions) >= directions.abs().amax(-1) - 1e-6
            found[here] = _sampled(maps, camera, directions[here])
    return found[..., :3], found[..., 3].clamp(0, 1), found[..., 4]


def in_sight(
    center: Float[Tensor, "3"], distance: Float[Tensor, "h w"], cameras: Sequence[Camera]
) -> Float[Tensor, "h w"]:
    """1 for directions in which something is that some camera has in its picture, else 0; softened
    by a few cells. 1 everywhere without cameras."""
    if not cameras:
        return torch.ones_like(distance)
    points = center + distance[..., None] * cell_directions(ROWS).to(distance)
    found = torch.zeros_like(distance, dtype=torch.bool)
    for camera in cameras:
        found |= camera.pictured(points)[2]
    around = torch.nn.functional.pad(found[None, None].to(distance), (2, 2, 0, 0), "circular")
    around = torch.nn.functional.pad(around, (0, 0, 2, 2), "replicate")
    return torch.nn.functional.avg_pool2d(around, 5, stride=1)[0, 0] * found


def filled(
    radiance: Float[Tensor, "h w 3"], seen: Float[Tensor, "h w"], up: Float[Tensor, "3"]
) -> Float[Tensor, "h w 3"]:
    """The light where it was seen; elsewhere the mean of what was, the nearest most, and overhead
    a soft white sky that is SKY times as bright as the mean."""
    weights = halved(seen[..., None], COARSE)
    areas = cell_areas(COARSE).to(radiance)
    few = halved(radiance * seen[..., None], COARSE) / weights.clamp_min(FAINT)
    kernel = (torch.acos(_cosines()).square() + FILL_ANGLE**2) ** -FILL_POWER
    smooth = filtered(few, kernel.to(few), weights[..., 0] * areas)
    around = look_up(smooth, cell_directions(ROWS).to(radiance))
    mass = weights[..., 0] * areas
    mean = (few * mass[..., None]).sum((0, 1)) / mass.sum().clamp_min(FAINT)
    white = (mean @ torch.from_numpy(LUMINANCE).to(mean)).expand(3)
    high = cell_directions(ROWS).to(radiance) @ up.to(radiance)
    overhead = ((high - OVERHEAD[0]) / (OVERHEAD[1] - OVERHEAD[0])).clamp(0, 1)[..., None]
    around = torch.lerp(around, (SKY * white).expand_as(around).maximum(around), overhead)
    return torch.lerp(around, radiance, seen[..., None])


def unclipped(display: Float[Tensor, "*s 3"]) -> Float[Tensor, "*s 3"]:
    """Linear light of display colors, times CLIPPED_GAIN where the brightest channel is clipped."""
    linear = torch.from_numpy(linear_of_srgb(display.clamp(0, 1).double().numpy())).to(display)
    low, high = CLIPPED
    share = ((display.amax(-1, keepdim=True) - low) / (high - low)).clamp(0, 1)
    return linear * (1 + (CLIPPED_GAIN - 1) * share.square() * (3 - 2 * share))


def studio(center: Float[Tensor, "3"], up: Float[Tensor, "3"]) -> Surroundings:
    """A grey studio: a large soft light above on either side, one behind, and a darker floor."""
    directions = cell_directions(ROWS)
    height = directions @ torch.nn.functional.normalize(up.float(), dim=0)
    light = 0.28 + 0.22 * height + lamps(up, LAMPS)
    areas = cell_areas(ROWS)
    # white paper has a mean light of 1, a studio less
    light = light * (0.8 * 4 * pi / (light * areas).sum())
    radiance = light[..., None].expand(-1, -1, 3).to(center)
    far = torch.full(light.shape, torch.inf, dtype=center.dtype)
    return Surroundings(center, radiance, far, torch.zeros_like(far), studio=True)


def lamps(
    up: Float[Tensor, "3"], which: Sequence[tuple[float, float, float, float, float]]
) -> Float[Tensor, "h w"]:
    """Light of round soft boxes: each (aside, ahead, above, radius in radians, brightness)."""
    up = torch.nn.functional.normalize(up.float(), dim=0)
    across = torch.nn.functional.normalize(
        torch.linalg.cross(up, torch.eye(3)[int(up.abs().argmin())]), dim=0
    )
    along = torch.linalg.cross(up, across)
    light = torch.zeros(ROWS, 2 * ROWS)
    for side, ahead, above, size, power in which:
        towards = torch.nn.functional.normalize(side * across + ahead * along + above * up, dim=0)
        angle = torch.acos((cell_directions(ROWS) @ towards).clamp(-1, 1))
        light += power * torch.sigmoid((size - angle) / 0.05)
    return light


def contrasted(
    surroundings: Surroundings, up: Float[Tensor, "3"], above: float = torch.inf
) -> tuple[Surroundings, bool]:
    """The surroundings as metals need them, and whether that is more than they were: key lights and
    a dark floor are mixed in until there are highlights and dark edges; as bright as before.
    Those overhead hang `above` the middle, in world units; others stay as far as they are."""
    luminance = torch.from_numpy(LUMINANCE).to(surroundings.radiance)
    areas = cell_areas(ROWS).to(luminance)
    before = surroundings.radiance
    mean = float((before @ luminance * areas).sum() / areas.sum())
    height = (cell_directions(ROWS) @ torch.nn.functional.normalize(up.float(), dim=0)).to(before)
    floor = torch.sigmoid(-(height + HORIZON) / 0.06)[..., None]
    keys = mean * lamps(up, KEYS).to(before)[..., None]
    before = torch.lerp(before, (before @ luminance)[..., None], PALER)
    found = surroundings
    for strength in MIXED:
        radiance = before * (1 - strength * (1 - DARK_FLOOR) * floor) + strength * keys
        radiance = radiance * (mean / float((radiance @ luminance * areas).sum() / areas.sum()))
        found = replace(surroundings, radiance=radiance)
        seen = softened(found, GLOSS) @ luminance
        dark, bright = (
            float(weighted_quantile(seen.reshape(-1, 1), areas.reshape(-1), share))
            for share in (DARK, BRIGHT)
        )
        if dark <= DARKEST * mean and bright >= BRIGHTEST * mean:
            break
    ceiling = torch.minimum(found.distance, above / height.clamp_min(HORIZON) ** 4)
    return replace(found, distance=ceiling), strength > 0


def with_studio(surroundings: Surroundings, up: Float[Tensor, "3"]) -> Surroundings:
    """The surroundings with a studio's light where nothing was seen."""
    lit = studio(surroundings.center, up).radiance
    seen = surroundings.seen[..., None]
    return replace(surroundings, radiance=torch.lerp(lit, surroundings.radiance, seen))


def balanced(surroundings: Surroundings, share: float = BALANCE) -> Surroundings:
    """The surroundings with a `share` of the mean light's color taken away; as bright as before."""
    radiance = surroundings.radiance
    mean = (radiance * cell_areas(len(radiance)).to(radiance)[..., None]).sum((0, 1)) / (4 * pi)
    luminance = mean @ torch.from_numpy(LUMINANCE).to(mean)
    gain = (luminance / mean.clamp_min(FAINT)) ** share
    gain = (
        gain * luminance / ((mean * gain) @ torch.from_numpy(LUMINANCE).to(mean)).clamp_min(FAINT)
    )
    return replace(surroundings, radiance=radiance * gain)


def prefiltered(surroundings: Surroundings) -> Float[Tensor, "r h w 3"]:
    """The surroundings as surfaces of each of ROUGHNESSES reflect them: GGX lobes seen head on, as
    in the split sum of Karis (2013)."""
    rough = [softened(surroundings, roughness) for roughness in ROUGHNESSES[1:]]
    return torch.stack([surroundings.radiance, *rough])


def softened(surroundings: Surroundings, roughness: float) -> Float[Tensor, "h w 3"]:
    """The surroundings as a surface of a roughness in (0, 1] reflects them, see `prefiltered`."""
    few = halved(surroundings.radiance, COARSE)
    lobe = filtered(few, _lobe(roughness).to(few), cell_areas(COARSE).to(few))
    return look_up(lobe, cell_directions(ROWS).to(few))


def reflected(
    maps: Float[Tensor, "r h w 3"], directions: Float[Tensor, "n 3"], roughness: Float[Tensor, " n"]
) -> Float[Tensor, "n 3"]:
    """Light from unit directions as surfaces of a roughness in [0, 1] see it; between the maps of
    `prefiltered`, linear."""
    steps = torch.tensor(ROUGHNESSES, dtype=directions.dtype)
    roughness = roughness.clamp(0, 1).contiguous()
    upper = torch.searchsorted(steps, roughness).clamp(1, len(steps) - 1)
    share = ((roughness - steps[upper - 1]) / (steps[upper] - steps[upper - 1]))[:, None]
    if len(directions) and bool((roughness == roughness[0]).all()):
        level = int(upper[0])
        return look_up(torch.lerp(maps[level - 1], maps[level], float(share[0])), directions)
    found = directions.new_zeros(len(directions), 3)
    for level in range(1, len(steps)):
        here = (upper == level).nonzero().squeeze(-1)
        if len(here):
            both = torch.cat((maps[level - 1], maps[level]), -1)
            low, high = look_up(both, directions[here]).split(3, -1)
            found[here] = torch.lerp(low, high, share[here])
    return found


def _sampled(
    maps: Float[Tensor, "p p c"], camera: Camera, directions: Float[Tensor, "m 3"]
) -> Float[Tensor, "m c"]:
    """Maps of a picture at directions, bilinear; the last one, depth, as distance, the nearest."""
    xy, _ = camera.project(camera.center.to(directions) + directions)
    grid = 2 * xy / camera.width - 1
    planes = maps.movedim(-1, 0)[None]
    bilinear = torch.nn.functional.grid_sample(
        planes[:, :-1], grid[None, None], padding_mode="border", align_corners=False
    )[0, :, 0].T
    at = xy.long().clamp(0, camera.width - 1)
    along = directions @ camera.forward.to(directions)
    distance = maps[at[:, 1], at[:, 0], -1] / along
    return torch.cat((bilinear, distance[:, None]), -1)


@lru_cache(1)
def _cosines() -> Float[Tensor, "m m"]:
    """Cosines of the angles between all pairs of cells of a coarse map."""
    flat = cell_directions(COARSE).reshape(-1, 3)
    return (flat @ flat.T).clamp(-1, 1)


@lru_cache(len(ROUGHNESSES))
def _lobe(roughness: float) -> Float[Tensor, "m m"]:
    """GGX's distribution at half the angle to the mirror direction, times the cosine."""
    alpha, cosine = max(roughness, 1e-3) ** 2, _cosines()
    spread = (1 + cosine) * ((alpha**2 - 1) / 2) + 1  # the squared cosine of half the angle
    return alpha**2 / spread.square() * cosine.clamp_min(0)


PATCHES = 60.0
"""Patches of paint that differ by chance, as many as the samples count for together."""
PAINT = 0.3
"""Their standard deviation, as a share of the mean."""
ALBEDOS = np.geomspace(0.08, 0.8, 10)
USUAL_ALBEDO, ALBEDO_SPREAD = 0.35, 0.5
"""Albedo of things, and the standard deviation of its logarithm."""
STIFF, LOOSE = 12.0, 0.5
"""Weight of a factor's squared distance from 1 where the panorama was seen, and where it was not
or is clipped."""
SHARPNESS = 20.0
"""Sharpness of a direction's factor over the panorama: half at 15 degrees."""


def as_shaded(
    surroundings: Surroundings,
    color: Float[Tensor, "m 3"],
    share: Float[Tensor, "m d"],
    weight: Float[Tensor, " m"],
    directions: Float[Tensor, "d 3"],
) -> Surroundings | None:
    """The surroundings with the light that best explains the subject's shading, in the channel that
    its paint sends most of: a deep red is no dark grey.

    `color` is linear light that each Gaussian sent to the cameras before, `share` the weight of
    each direction in what it receives, 1 in all where nothing is hidden, and `weight` how much it
    counts. None where it is brighter than the lightest paint would be, as on a dark tile with
    nothing around.
    """
    luminance = torch.from_numpy(LUMINANCE).to(directions)
    light = look_up(surroundings.radiance, directions) @ luminance
    most = ALBEDOS[-1] * (share @ light)
    if float(((color @ luminance - most) * weight).sum()) > 0:
        return None
    rows = weight.argsort(descending=True, stable=True)[:2000]  # these fill the pictures most
    clipped = ((light - 0.6) / (0.5 * CLIPPED_GAIN)).clamp(0, 1)
    seen = look_up(surroundings.seen[..., None], directions)[:, 0] * (1 - clipped)
    stiff = (LOOSE + (STIFF - LOOSE) * seen).double().numpy()
    design = (share * light)[rows].double().numpy()
    factors = _factors(design, color.amax(-1)[rows].double().numpy(), stiff)
    cells = cell_directions(len(surroundings.radiance)).to(directions)
    near = torch.exp(SHARPNESS * (cells @ directions.T - 1))
    smooth = (near @ torch.from_numpy(factors).to(near)) / near.sum(-1)
    return replace(surroundings, radiance=surroundings.radiance * smooth[..., None])


def light_near(
    design: Float64[np.ndarray, "m d"],
    shown: Float64[np.ndarray, " m"],
    usual: Float64[np.ndarray, " d"] | float,
    pull: Float64[np.ndarray, " d"],
) -> tuple[Float64[np.ndarray, " d"], float]:
    """Strengths of light from directions, at least 0, that explain what surfaces show, near usual
    ones by the `pull` of each; and the root of the squared error."""
    from scipy.optimize import nnls

    return nnls(np.concatenate((design, np.diag(pull))), np.concatenate((shown, pull * usual)))


def _factors(design: np.ndarray, shown: np.ndarray, stiff: np.ndarray) -> np.ndarray:
    """The factors of directions, at the albedo that makes them likeliest."""
    count = np.sqrt(PATCHES / len(shown)) / (PAINT * max(float(shown.mean()), 1e-4))
    best, least = np.ones(design.shape[1]), np.inf
    # errors within the design's column space, as small a system; the rest is the same for all
    basis, design = np.linalg.qr(design)
    shown = basis.T @ shown
    for albedo in ALBEDOS:
        factors, error = light_near(count * albedo * design, count * shown, 1.0, np.sqrt(stiff))
        cost = error**2 + (np.log(albedo / USUAL_ALBEDO) / ALBEDO_SPREAD) ** 2
        if cost < least:
            best, least = factors, cost
    return best.clip(0, 8.0)
