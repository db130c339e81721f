"""Places from which a scene may have been captured, found from the scene alone.

Cameras stand in free space and see closed, sharp surfaces: many small Gaussians a pixel. Elsewhere
floaters and large splats are in front. So hundreds of places are compared by their panoramas.

A panorama has `b` bins, the cells of the six faces of a cube. Each of `m` sampled Gaussians counts
in the bin of its center, and one that is wider than a bin also in those that it covers, blended
from front to back: coarse, but rendered in milliseconds. `p` places, `d` directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, radians

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.scene.quaternions import even_directions
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

FOV = 55.0
"""Degrees, of found views: between a phone's camera and its wide lens."""
OPAQUE, BLUR = 4.0, 3.0
"""Weights in the score of a view, beside the logarithm of the number of Gaussians a pixel. Chosen
on three synthetic captures (docs/measurements/views.md)."""


@dataclass(frozen=True)
class SearchEffort:
    """Numbers of places and of small renders that a search for views tries."""

    places: int = 300
    """Places that are proposed at first."""
    kept: int = 32
    """Best places that are moved on."""
    directions: int = 120
    """Evenly spread ones in which the panoramas are searched: 120 are 20 degrees apart."""
    rendered: int = 96
    """Renders of views that differ."""


EFFORT = SearchEffort()


@dataclass(frozen=True, eq=False)
class ViewConstraints:
    """Constraints that a person puts on the views; None: found from the scene."""

    up: Float[Tensor, "3"] | None = None
    """Any length but 0."""
    look_at: Float[Tensor, "3"] | None = None
    """A point that all views look at."""
    eye: Float[Tensor, "3"] | None = None
    """A point that views are taken from, or from beside it."""


SIDE = 10
"""Cells a side of a face: 9 degrees."""
WIDE = 0.08
"""Angular radius, radians, about half a cell: wider ones are spread over cells."""
BLURRED = 0.06
"""Angular radius, radians, of a splat in which no detail is seen: a 20th of a 70 degree picture."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Gaussians drawn at random from a scene, in the numbers that a panorama needs. Float32."""

    means: Float[Tensor, "m 3"]
    depth: Float[Tensor, " m"]
    """Optical depth through the center, times the number of Gaussians that each one stands for."""
    areas: Float[Tensor, "m 3 3"]
    """v^T areas v is the square of the area 2 pi s s' across the unit direction v, world units."""
    size: Float[Tensor, " m"]
    """Geometric mean of the two larger standard deviations."""
    normals: Float[Tensor, "m 3"]
    """The thin axis: of a surface its normal, of either sign."""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Sums over the Gaussians of each bin, by their blending weights times the solid angle."""

    weight: Float[Tensor, " b"]
    square: Float[Tensor, " b"]
    """Sum of the squared weights: few Gaussians with large weights make a blurred picture."""
    blurred: Float[Tensor, " b"]
    """Sum of the weights of Gaussians that are wider than BLURRED."""
    log_distance: Float[Tensor, " b"]

    @property
    def reach(self) -> Float[Tensor, ""]:
        """Geometric mean distance of what is seen, world units."""
        return (self.log_distance.sum() / self.weight.sum().clamp_min(1e-9)).exp()


def draw_sample(scene: Gaussians, generator: torch.Generator, count: int = 20_000) -> Sample:
    """`count` Gaussians of a scene, or all if there are fewer."""
    rows = torch.randperm(len(scene), generator=generator)[:count]
    some = scene[rows].to(torch.float32)
    scales = some.scales
    across = torch.stack([scales[:, 1] * scales[:, 2], scales[:, 0] * scales[:, 2],
                          scales[:, 0] * scales[:, 1]], -1)  # fmt: skip
    turned = rotation_matrices(some.quats)
    axes = turned * (2 * torch.pi * across)[:, None]
    thin = scales.argmin(-1)[:, None, None].expand(-1, 3, 1)
    larger = scales.sort(-1).values[:, 1:]
    depth = -torch.log1p(-some.opacities.clamp_max(0.99)) * (len(scene) / len(rows))
    return Sample(some.means, depth, axes @ axes.mT, larger.prod(-1).sqrt(),
                  turned.gather(2, thin)[..., 0])  # fmt: skip


@lru_cache(maxsize=1)  # hundreds of places are compared
def bin_directions() -> tuple[Float[Tensor, "b 3"], Float[Tensor, " b"]]:
    """The unit direction of each bin's center, and its solid angle."""
    grid = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
    u, v = (x.reshape(-1) for x in torch.meshgrid(grid, grid, indexing="ij"))
    one = torch.ones_like(u)
    faces = []
    for axis in range(3):
        for sign in (1, -1):
            columns = [u, v]
            columns.insert(axis, sign * one)
            faces.append(torch.stack(columns, -1))
    directions = torch.cat(faces)
    solid = (2 / SIDE) ** 2 / directions.norm(dim=-1) ** 3
    return torch.nn.functional.normalize(directions, dim=-1), solid


def _bins(vectors: Float[Tensor, "m 3"]) -> Int[Tensor, " m"]:
    """The bin that each direction falls into, in the order of `bin_directions`."""
    x, y, z = vectors.abs().unbind(-1)
    axis = torch.where(x >= torch.maximum(y, z), 0, torch.where(y >= z, 1, 2))
    along = vectors.gather(-1, axis[:, None])[:, 0]
    others = torch.tensor([[1, 2], [0, 2], [0, 1]])[axis]
    uv = vectors.gather(-1, others) / along.abs().clamp_min(1e-12)[:, None]
    cell = ((uv + 1) * (SIDE / 2)).long().clamp(0, SIDE - 1)
    return (2 * axis + (along < 0)) * SIDE**2 + cell[:, 0] * SIDE + cell[:, 1]


def _covered(
    towards: Float[Tensor, "w 3"], radius: Float[Tensor, " w"], directions: Float[Tensor, "b 3"]
) -> tuple[Int[Tensor, " c"], Int[Tensor, " c"], Float[Tensor, " c"]]:
    """Pairs of wide Gaussians and bins within two of their radii, with the angles in radii."""
    cosine = (towards @ directions.T).clamp(-1, 1)
    least = torch.cos((2 * radius + 0.01).clamp_max(pi))  # angles are slow: only of these pairs
    wide, bins = (cosine >= least[:, None]).nonzero().unbind(-1)
    angle = torch.acos(cosine[wide, bins]) / radius[wide]
    near = angle < 2
    return wide[near], bins[near], angle[near]


def panorama(sample: Sample, point: Float[Tensor, "3"]) -> Panorama:
    """The panorama at a point."""
    directions, solid = bin_directions()
    offset = sample.means - point.float()
    distance = offset.norm(dim=-1).clamp_min(1e-9)
    towards = offset / distance[:, None]
    radius = sample.size / distance
    area = torch.einsum("mi,mij,mj->m", towards, sample.areas, towards).clamp_min(0).sqrt()
    cell = _bins(towards)
    depth = sample.depth * (area / distance**2 / solid[cell]).clamp_max(1)
    rows = torch.arange(len(cell))
    wide = (radius > WIDE).nonzero()[:, 0]
    wide = wide[(radius[wide].clamp_max(1) ** 2 * sample.depth[wide]).argsort(descending=True)]
    wide = wide[:300]
    if len(wide):
        covered, covering, angle = _covered(towards[wide], radius[wide], directions)
        depth[wide] = 0
        spread = sample.depth[wide[covered]] * torch.exp(-(angle**2) / 2)
        rows, cell = torch.cat((rows, wide[covered])), torch.cat((cell, covering))
        depth = torch.cat((depth, spread))
    # by cell, and in each by distance: floats of one sign are ordered as their bits are
    order = ((cell << 32) + distance[rows].view(torch.int32)).argsort()
    rows, cell, depth = rows[order], cell[order], depth[order].double()
    through = depth.cumsum(0)
    first = torch.searchsorted(cell, torch.arange(len(solid)))
    before = torch.cat((through.new_zeros(1), through))[first][cell]
    weight = (torch.exp(-(through - depth - before)) * -torch.expm1(-depth)).float() * solid[cell]

    def total(values: Float[Tensor, " k"]) -> Float[Tensor, " b"]:
        return torch.zeros(len(solid)).index_add(0, cell, values)

    return Panorama(
        total(weight),
        total(weight * weight),
        total(weight * (radius[rows] > BLURRED)),
        total(weight * distance[rows].log()),
    )


@dataclass(frozen=True, eq=False)
class Places:
    """Places and what is seen from them."""

    points: Float[Tensor, "p 3"]
    views: list[Panorama]

    @property
    def enclosed(self) -> float:
        """The share of all directions that is opaque, the median over the places."""
        return float(torch.stack([view.weight.sum() for view in self.views]).median()) / (4 * pi)


def propose(sample: Sample, count: int, generator: torch.Generator) -> Float[Tensor, "p 3"]:
    """Places where a camera may have stood: a third each around the scene, between two of its
    Gaussians (inside a room), and in front of one Gaussian, along its thin axis."""
    points = sample.means
    center = points.median(0).values
    distance = (points - center).norm(dim=-1)
    third = count // 3

    def rows() -> Tensor:
        return torch.randint(len(points), (third,), generator=generator)

    def uniform(low: float, high: float) -> Float[Tensor, "p 1"]:
        return low + (high - low) * torch.rand(third, 1, generator=generator)

    outward = torch.nn.functional.normalize(torch.randn(third, 3, generator=generator), dim=-1)
    quantiles = distance.quantile(torch.tensor([0.3, 0.6, 0.85]))
    around = center + outward * quantiles.repeat(third)[:third, None] * uniform(0.3, 2.0)
    share = uniform(0.1, 0.9)
    between = share * points[rows()] + (1 - share) * points[rows()]
    some = rows()
    side = torch.sign(uniform(-1.0, 1.0))
    reach = quantiles[1] * torch.exp(uniform(-2.0, 0.7))
    before = points[some] + side * reach * sample.normals[some]
    return torch.cat((around, between, before))


def score_panorama(view: Panorama, masks: Float[Tensor, "d b"]) -> Float[Tensor, " d"]:
    """The score of looking into each direction: opaque, sharp and not blurred (AUC 0.98 against
    what cameras really saw, docs/measurements/views.md). `masks` are 1 for the bins in view."""
    _, solid = bin_directions()
    weight = (masks @ view.weight).clamp_min(1e-9)
    detail = (weight / (masks @ view.square).clamp_min(1e-12)).clamp_min(1e-3).log()
    opaque = weight / (masks @ solid)
    return detail + OPAQUE * opaque - BLUR * (masks @ view.blurred) / weight


def cones(directions: Float[Tensor, "d 3"]) -> Float[Tensor, "d b"]:
    """1 for the bins within half a picture of each direction."""
    bins, _ = bin_directions()
    return (directions.float() @ bins.T > cos(radians(0.6 * FOV))).float()


def find_places(
    sample: Sample, wish: ViewConstraints, generator: torch.Generator, effort: SearchEffort = EFFORT
) -> Places:
    """The best places: proposed, then moved at random in three rounds, by ever less.

    Around `wish.eye`, if there is one.
    """
    masks = cones(directions_around(80))
    if wish.eye is not None:
        points = wish.eye.float().expand(effort.kept, 3).clone()
        near = 0.15 * panorama(sample, points[0]).reach
        points[1:] += near * torch.randn(effort.kept - 1, 3, generator=generator)
        return Places(points, [panorama(sample, point) for point in points])
    points = propose(sample, effort.places, generator)
    places = Places(points, [panorama(sample, point) for point in points])
    for step in (0.4, 0.2, 0.1):
        best = _best(places, masks, effort.kept)
        reach = torch.stack([view.reach for view in best.views])
        noise = torch.randn(len(reach), 3, 3, generator=generator)
        moved = (best.points[:, None] + step * reach[:, None, None] * noise).reshape(-1, 3)
        views = [panorama(sample, point) for point in moved]
        places = Places(torch.cat((best.points, moved)), best.views + views)
    return _best(places, masks, 2 * effort.kept)


def _best(places: Places, masks: Float[Tensor, "d b"], count: int) -> Places:
    scores = torch.stack([score_panorama(view, masks).max() for view in places.views])
    best = scores.argsort(descending=True)[:count]
    return Places(places.points[best], [places.views[i] for i in best.tolist()])


def directions_around(count: int) -> Float[Tensor, "d 3"]:
    """Evenly spread unit directions, float32."""
    return torch.from_numpy(even_directions(count)).float()
