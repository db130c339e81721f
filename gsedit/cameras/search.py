"""Places from which a scene may have been captured, found from the scene alone.

Real cameras stand in free space and see closed, sharp surfaces: many small Gaussians a pixel, none
that covers much of the picture. Where no camera was, floaters and large splats are in front. So
hundreds of places, inside the scene and around it, are compared by their panoramas.
`p` places, `d` directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.panorama import Panorama, Sample, bin_directions, panorama
from gsedit.scene.quaternions import even_directions

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
    rendered: int = 32
    """Renders of views that differ."""
    varied: int = 24
    """Renders a round of variations of the best views."""
    rounds: tuple[int, int] = (2, 4)
    """Rounds of variations: the least, and the most while too few views are admitted."""


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
    Gaussians (inside a room), and in front of one Gaussian, along its thin axis.
    """
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
    what cameras really saw, docs/measurements/views.md). `masks` are 1 for the bins in view.
    """
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
    sample: Sample,
    wish: ViewConstraints,
    generator: torch.Generator,
    effort: SearchEffort = EFFORT,
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
