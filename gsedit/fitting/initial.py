"""Where a fit starts: Gaussians at the sparse points of a dataset, or at random ones."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.files import mesh
from gsedit.views.dataset import Dataset, View
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

RANDOM_POINTS = 20_000
"""Gaussians of a fit whose dataset has no points."""
INITIAL_OPACITY = 0.2


def initial_scene(dataset: Dataset, sh_degree: int, generator: torch.Generator) -> Gaussians:
    """Round Gaussians at the sparse points, as wide as their neighbours are far.

    With fewer than 4 points, at random places where the cameras look. Colours are the points', or
    grey where they have none.
    """
    points, colors = dataset.points, dataset.point_colors
    if points is None or len(points) < 4:
        points, colors = _random_points(dataset.views, RANDOM_POINTS, generator), None
    points = points.float()
    colors = torch.full_like(points, 0.5) if colors is None else colors.float()
    spacing = neighbour_distance(points).clamp_min(1e-7)
    # wide enough to close the surface at once: holes are what a short fit never fills
    log_scales = spacing.log()[:, None].expand(-1, 3)
    sh = torch.zeros(len(points), (sh_degree + 1) ** 2, 3)
    sh[:, 0] = (colors - 0.5) / SH_DC
    quats = torch.zeros(len(points), 4)
    quats[:, 0] = 1
    logits = torch.full((len(points),), float(torch.logit(torch.tensor(INITIAL_OPACITY))))
    return Gaussians(points.contiguous(), quats, log_scales.clone(), logits, sh)


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
