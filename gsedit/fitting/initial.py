"""Where a fit starts: Gaussians at a dataset's sparse points and where its photos agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.files import mesh
from gsedit.fitting.sweep import swept_points
from gsedit.ranks import ALONE, Ranks
from gsedit.views.dataset import Dataset, View
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

RANDOM_POINTS = 20_000
"""Gaussians of a fit whose dataset has no points, and whose photos agree on none."""
INITIAL_OPACITY = 0.2
FEW = 4
"""Points below this number show no scene."""
MEASURED_POINTS = 50_000
"""Points, at most, whose depths in the photos are measured: captures have millions."""

Points = tuple[Float[Tensor, "m 3"], Float[Tensor, "m 3"]]
"""World positions and RGB colours in [0, 1]."""


def initial_scene(
    dataset: Dataset,
    sh_degree: int,
    generator: torch.Generator,
    *,
    swept: int = 0,
    at_most: int | None = None,
    ranks: Ranks = ALONE,
    out_of_time: Callable[[], bool] = lambda: False,
) -> Gaussians:
    """Round Gaussians at the sparse points, as wide as their neighbours are far.

    `swept` patches of the photos that are not held out are looked for in space besides (see
    fitting.sweep), until `out_of_time`. With fewer than 4 points of both kinds, at random places
    where the cameras look. Colours are the points', or grey where they have none. Of more points
    than `at_most`, a random choice is taken.
    """
    points = torch.zeros(0, 3) if dataset.points is None else dataset.points.float()
    grey = torch.full_like(points, 0.5)
    colors = grey if dataset.point_colors is None else dataset.point_colors.float()
    if swept:
        more, theirs = _swept(dataset.split()[0], points, swept, generator, ranks, out_of_time)
        points, colors = torch.cat((points, more)), torch.cat((colors, theirs))
    if len(points) < FEW:
        points = _random_points(dataset.views, RANDOM_POINTS, generator)
        colors = torch.full_like(points, 0.5)
    if at_most is not None and len(points) > at_most:
        chosen = torch.randperm(len(points), generator=generator)[:at_most].sort().values
        points, colors = points[chosen], colors[chosen]
    return round_gaussians(points, colors, INITIAL_OPACITY, sh_degree)


def round_gaussians(
    points: Float[Tensor, "n 3"], colors: Float[Tensor, "n 3"], opacity: float, sh_degree: int
) -> Gaussians:
    """Round Gaussians, as wide as their three nearest neighbours are far: wide enough to close the
    surface at once, for holes are what a short fit never fills. RGB colours in [0, 1]."""
    count = len(points)
    spacing = neighbour_distance(points).clamp_min(1e-7)
    sh = torch.zeros(count, (sh_degree + 1) ** 2, 3)
    sh[:, 0] = (colors - 0.5) / SH_DC
    quats = torch.zeros(count, 4)
    quats[:, 0] = 1
    log_scales = spacing.log()[:, None].repeat(1, 3)
    logit = float(torch.logit(torch.tensor(opacity)))
    return Gaussians(points.contiguous(), quats, log_scales, torch.full((count,), logit), sh)


def _swept(
    views: Sequence[View],
    points: Float[Tensor, "n 3"],
    count: int,
    generator: torch.Generator,
    ranks: Ranks,
    out_of_time: Callable[[], bool],
) -> Points:
    """Of rank 0, for all: another machine's rounding might find one point more."""
    seed = int(torch.randint(2**31, (), generator=generator))
    found = None
    if ranks.rank == 0:
        inverse_depths = _inverse_depths(views, points)
        own = torch.Generator().manual_seed(seed)
        found = swept_points(views, count, inverse_depths, own, out_of_time)
    shared = ranks.first(found)
    assert shared is not None
    return shared


def _inverse_depths(views: Sequence[View], points: Float[Tensor, "n 3"]) -> tuple[float, float]:
    """The smallest and the largest inverse depth at which a photo may show something.

    Those of the sparse points in the photos, and somewhat beyond; without points from a hundredth
    to three times that of the place that the cameras look at.
    """
    inverse = []
    points = points[:: -(-len(points) // MEASURED_POINTS) or 1]
    for view in views[:: max(1, len(views) // 16)]:
        xy, depth = view.camera.project(points.double())
        size = xy.new_tensor((view.camera.width, view.camera.height))
        inverse.append(1 / depth[(depth > 0) & (xy > 0).all(-1) & (xy < size).all(-1)])
    if sum(map(len, inverse)) < FEW:
        near = 1 / _distance_to_focus(views)
        return near / 100, 3 * near
    # three points of a thousand may be wrong
    bounds = torch.tensor([0.003, 0.997], dtype=torch.float64)
    low, high = torch.cat(inverse).quantile(bounds).tolist()
    return low / 2, 1.1 * high


def _distance_to_focus(views: Sequence[View]) -> float:
    """The cameras' median distance from the place that is nearest to all their axes."""
    centres = torch.stack([view.camera.centre for view in views]).double()
    axes = torch.stack([view.camera.forward for view in views]).double()
    across = torch.eye(3, dtype=torch.float64) - axes[:, :, None] * axes[:, None, :]
    right = (across @ centres[:, :, None]).sum(0)
    focus = torch.linalg.lstsq(across.sum(0), right).solution[:, 0]
    return max(1e-6, float((focus - centres).norm(dim=-1).median()))


def neighbour_distance(points: Float[Tensor, "n 3"], neighbours: int = 3) -> Float[Tensor, " n"]:
    """Root mean squared distance to the nearest few other points."""
    distance = mesh.neighbour_distance(points.double().numpy(), neighbours)
    return torch.from_numpy(distance).to(points.dtype)


def _random_points(
    views: tuple[View, ...], count: int, generator: torch.Generator
) -> Float[Tensor, "n 3"]:
    """Points in the ball that the cameras look into."""
    centres = torch.stack([v.camera.centre for v in views])
    middle = centres.mean(0)
    radius = (centres - middle).norm(dim=-1).max().clamp_min(1e-3)
    direction = torch.randn(count, 3, generator=generator, dtype=centres.dtype)
    direction = torch.nn.functional.normalize(direction, dim=-1)
    distance = torch.rand(count, 1, generator=generator, dtype=centres.dtype) ** (1 / 3)
    return (middle + 1.5 * radius * distance * direction).float()
