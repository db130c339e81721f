"""Start of a fit: Gaussians at a dataset's sparse points and where its photos agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import ceil, gcd, sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.formats.mesh import neighbor_distance
from gsedit.views.dataset import Dataset, View
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians

RANDOM_POINTS = 20_000
"""Gaussians of a fit whose dataset has no points, and whose photos agree on none."""
INITIAL_OPACITY = 0.2
MIN_POINTS = 4
"""Points below this number show no scene."""
MEASURED_POINTS = 50_000
"""Points, at most, whose depths in the photos are measured: captures have millions."""


def initial_scene(
    dataset: Dataset,
    sh_degree: int,
    generator: torch.Generator,
    *,
    swept: int = 0,
    at_most: int | None = None,
    out_of_time: Callable[[], bool] = lambda: False,
) -> Gaussians:
    """Round Gaussians at the sparse points, as wide as their neighbors are far.

    `swept` patches of the photos that are not held out are looked for in space besides (see
    `swept_points`), until `out_of_time`. With fewer than 4 points of both
    kinds, at random places where the cameras look. Colors are the points', or grey where they have
    none. Of more points than `at_most`, a random choice is taken.
    """
    points = torch.zeros(0, 3) if dataset.points is None else dataset.points.float()
    grey = torch.full_like(points, 0.5)
    colors = grey if dataset.point_colors is None else dataset.point_colors.float()
    if swept:
        own = torch.Generator().manual_seed(int(torch.randint(2**31, (), generator=generator)))
        photos = dataset.split()[0]
        depths = _inverse_depths(photos, points)
        more, theirs = swept_points(photos, swept, depths, own, out_of_time)
        points, colors = torch.cat((points, more)), torch.cat((colors, theirs))
    if len(points) < MIN_POINTS:
        points = _random_points(dataset.views, RANDOM_POINTS, generator)
        colors = torch.full_like(points, 0.5)
    if at_most is not None and len(points) > at_most:
        chosen = torch.randperm(len(points), generator=generator)[:at_most].sort().values
        points, colors = points[chosen], colors[chosen]
    return round_gaussians(points, colors, INITIAL_OPACITY, sh_degree)


def round_gaussians(
    points: Float[Tensor, "n 3"], colors: Float[Tensor, "n 3"], opacity: float, sh_degree: int
) -> Gaussians:
    """Round Gaussians, as wide as their three nearest neighbors are far: wide enough to close the
    surface at once, for holes are what a short fit never fills. RGB colors in [0, 1]."""
    count = len(points)
    distance = neighbor_distance(points.double().numpy())
    spacing = torch.from_numpy(distance).to(points.dtype).clamp_min(1e-7)
    sh = torch.zeros(count, (sh_degree + 1) ** 2, 3)
    sh[:, 0] = color_to_sh(colors)
    quats = torch.zeros(count, 4)
    quats[:, 0] = 1
    log_scales = spacing.log()[:, None].repeat(1, 3)
    logit = float(torch.logit(torch.tensor(opacity)))
    return Gaussians(points.contiguous(), quats, log_scales, torch.full((count,), logit), sh)


def _inverse_depths(views: Sequence[View], points: Float[Tensor, "n 3"]) -> tuple[float, float]:
    """The smallest and the largest inverse depth at which a photo may show something.

    Those of some sparse points in the photos, and somewhat beyond; without points from a
    hundredth to three times that of the place that the cameras look at.
    """
    inverse = []
    points = points[:: -(-len(points) // MEASURED_POINTS) or 1]
    for view in views[:: max(1, len(views) // 16)]:
        _, depth, inside = view.camera.pictured(points.double())
        inverse.append(1 / depth[inside])
    if sum(map(len, inverse)) < MIN_POINTS:
        near = 1 / _distance_to_focus(views)
        return near / 100, 3 * near
    # three points of a thousand may be wrong
    bounds = torch.tensor([0.003, 0.997], dtype=torch.float64)
    low, high = torch.cat(inverse).quantile(bounds).tolist()
    return low / 2, 1.1 * high


def _distance_to_focus(views: Sequence[View]) -> float:
    """The cameras' median distance from the place that is nearest to all their axes."""
    centers = torch.stack([view.camera.center for view in views]).double()
    axes = torch.stack([view.camera.forward for view in views]).double()
    across = torch.eye(3, dtype=torch.float64) - axes[:, :, None] * axes[:, None, :]
    right = (across @ centers[:, :, None]).sum(0)
    focus = torch.linalg.lstsq(across.sum(0), right).solution[:, 0]
    return max(1e-6, float((focus - centers).norm(dim=-1).median()))


def _random_points(
    views: tuple[View, ...], count: int, generator: torch.Generator
) -> Float[Tensor, "n 3"]:
    """Points in the ball that the cameras look into."""
    centers = torch.stack([v.camera.center for v in views])
    middle = centers.mean(0)
    radius = (centers - middle).norm(dim=-1).max().clamp_min(1e-3)
    direction = torch.randn(count, 3, generator=generator, dtype=centers.dtype)
    direction = torch.nn.functional.normalize(direction, dim=-1)
    distance = torch.rand(count, 1, generator=generator, dtype=centers.dtype) ** (1 / 3)
    return (middle + 1.5 * radius * distance * direction).float()


SIDE = 160
"""Pixels on the longer side of the pictures that are compared."""
RADIUS, SPACING = 2, 2
"""A patch is a square of pixels that reach so far, so far apart: 3x3 of them."""
PIXELS = 25
"""Least pixels of a compared picture for each patch: patches do not overlap. With 4, 40 photos of
64 pixels give three times the Gaussians, and a fit of 5 CPU seconds 2.5 dB less."""
DEPTHS = 32
"""Number of depths of a sweep, evenly spaced in their inverse, as a patch's places in a neighbor
are."""
NEIGHBORS = 3
"""Photos that one is compared with. The worst does not count: something may hide the place."""
AGREEMENT = 0.6
"""Smallest normalised correlation of a patch with the neighbors."""
FLAT = 0.01
"""The standard deviation of grey values below which a patch does not show its depth."""


@torch.no_grad()
def swept_points(
    views: Sequence[View],
    count: int,
    inverse_depths: tuple[float, float],
    generator: torch.Generator,
    out_of_time: Callable[[], bool] = lambda: False,
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """(places, colors) that photos agree on: of about `count` patches, the good ones.

    `inverse_depths`: the smallest and the largest that are tried, above 0. `out_of_time` is asked
    before each photo: the rest give none.
    """
    small = cache(lambda row: _small(views[row]))  # read when it is needed
    centers = torch.stack([view.camera.center for view in views])
    axes = torch.stack([view.camera.forward for view in views])
    places, colors = [torch.zeros(0, 3)], [torch.zeros(0, 3)]
    for i in _spread(len(views)):
        if out_of_time():
            break
        if neighbors := _neighbors(centers, axes, i):
            view, others = small(i), [small(j) for j in neighbors]
            most = view.camera.width * view.camera.height // PIXELS
            wanted = min(ceil(count / len(views)), most)
            patches = _grid(view, max(1, wanted), generator)
            depth, good = _sweep(view, others, patches, inverse_depths)
            good &= _supervised(view, patches)
            places.append(view.camera.unproject(patches[good], depth[good]))
            colors.append(_sampled(view.image, view.camera, patches[good]))
    return torch.cat(places), torch.cat(colors)


def _spread(count: int) -> list[int]:
    """0 to `count` - 1 such that the first few are spread over all: neighbors come in turn."""
    stride = next(
        step for step in range(round(0.38 * count) or 1, count + 1) if gcd(step, count) == 1
    )
    return [i * stride % count for i in range(count)]


def _small(view: View) -> View:
    camera = view.camera.fitted(SIDE)
    return view.resized(camera.width, camera.height)


def _neighbors(centers: Float[Tensor, "v 3"], axes: Float[Tensor, "v 3"], i: int) -> list[int]:
    """The cameras nearest to camera i, elsewhere, that look about the same way: within 60 degrees.

    `axes`: along which they look, of length 1.
    """
    distances = (centers - centers[i]).norm(dim=-1)
    candidates = ((axes @ axes[i] > 0.5) & (distances > 0)).nonzero().squeeze(-1)
    order = distances[candidates].argsort(stable=True)[:NEIGHBORS]
    return candidates[order].tolist()


def _grid(view: View, count: int, generator: torch.Generator) -> Float[Tensor, "p 2"]:
    """About `count` pixel positions, one at a random place in each square of a grid."""
    width, height = view.camera.width, view.camera.height
    step = sqrt(width * height / count)
    corners = torch.cartesian_prod(torch.arange(0, width, step), torch.arange(0, height, step))
    places = corners + step * torch.rand(len(corners), 2, generator=generator)
    return torch.minimum(places.clamp_min(RADIUS), places.new_tensor((width, height)) - RADIUS)


def _sweep(
    view: View,
    others: Sequence[View],
    centers: Float[Tensor, "p 2"],
    inverse_depths: tuple[float, float],
) -> tuple[Float[Tensor, " p"], Bool[Tensor, " p"]]:
    """The best depth of each patch, to a fraction of a step, and whether photos agree on it."""
    offsets = torch.arange(-RADIUS, RADIUS + 1, SPACING).float()
    pixels = centers[:, None] + torch.cartesian_prod(offsets, offsets)
    own, deviation = _normalised(_sampled(_grey(view), view.camera, pixels)[..., 0])
    low, high = inverse_depths
    step = (high - low) / DEPTHS
    inverse = low + step * (torch.arange(DEPTHS) + 0.5)
    match = torch.stack([_agreement(view, own, pixels, other, inverse) for other in others])
    match = match.sort(0, descending=True).values[: max(1, len(others) - 1)].mean(0)
    best, index = match.max(0)
    inner = index.clamp(1, DEPTHS - 2)
    before, at, after = (match.gather(0, (inner + k)[None])[0] for k in (-1, 0, 1))
    peak = (after - before) / (2 * (2 * at - before - after).clamp_min(1e-6))  # of the parabola
    shift = torch.where(inner == index, peak.clamp(-0.5, 0.5), 0.0)
    return 1 / (inverse[index] + step * shift), (best > AGREEMENT) & (deviation > FLAT)


def _agreement(
    view: View,
    own: Float[Tensor, "p s"],
    pixels: Float[Tensor, "p s 2"],
    other: View,
    inverse: Float[Tensor, " k"],
) -> Float[Tensor, "k p"]:
    """Correlation of each patch with another photo at each depth; -1 where that cannot be."""
    here, there, grey = view.camera, other.camera, _grey(other)
    relative = there.world_to_camera.double() @ here.world_to_camera.double().inverse()
    relative, size = relative.to(pixels), pixels.new_tensor((there.width, there.height))
    x, y = (pixels[..., 0] - here.cx) / here.fx, (pixels[..., 1] - here.cy) / here.fy
    turned = torch.stack((x, y, torch.ones_like(x)), -1) @ relative[:3, :3].T
    rows = []
    for one in inverse.tolist():
        x, y, z = (turned + one * relative[:3, 3]).unbind(-1)  # the place over its depth
        xy = torch.stack((there.fx * x / z + there.cx, there.fy * y / z + there.cy), -1)
        inside = (z > 0) & (xy > 0).all(-1) & (xy < size).all(-1)
        theirs, _ = _normalised(_sampled(grey, there, xy)[..., 0])
        rows.append(torch.where(inside.all(-1), (own * theirs).mean(-1), -1.0))
    return torch.stack(rows)


def _grey(view: View) -> Float[Tensor, "h w 1"]:
    return view.image.mean(-1, keepdim=True)


def _supervised(view: View, xy: Float[Tensor, "p 2"]) -> Bool[Tensor, " p"]:
    """Mark pixel positions that are neither masked nor transparent."""
    shown = torch.ones(len(xy), dtype=torch.bool)
    for kept in (view.mask, view.alpha):
        if kept is not None:
            shown &= _sampled(kept[..., None].float(), view.camera, xy)[:, 0] > 0.5
    return shown


def _sampled(
    image: Float[Tensor, "h w c"], camera: Camera, xy: Float[Tensor, "*p 2"]
) -> Float[Tensor, "*p c"]:
    """The picture at pixel positions, linear in between; the border's value beyond it."""
    size = xy.new_tensor((camera.width, camera.height))
    grid = (2 * xy / size - 1).nan_to_num(0).reshape(1, 1, -1, 2)
    values = torch.nn.functional.grid_sample(
        image.movedim(-1, 0)[None], grid, align_corners=False, padding_mode="border"
    )
    return values[0, :, 0].T.reshape(*xy.shape[:-1], image.shape[-1])


def _normalised(values: Float[Tensor, "p s"]) -> tuple[Float[Tensor, "p s"], Float[Tensor, " p"]]:
    """With mean 0 and standard deviation 1; and what that was."""
    centered = values - values.mean(-1, keepdim=True)
    deviation = centered.square().mean(-1).sqrt()
    return centered / deviation.clamp_min(1e-4)[:, None], deviation
