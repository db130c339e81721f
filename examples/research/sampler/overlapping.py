"""Overlapping views of one picture: tests of consensus.

`v` views, `h w` pixels, `y x` cells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.paper.consistency.consensus import consensus, share_noise
from gsedit.paper.diffusion.guidance import Branches, Need, Prediction
from gsedit.paper.diffusion.sampler import add_noise, levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings
from research.sampler.measurements import rms

VIEWS = 4


@dataclass(frozen=True, eq=False)
class OverlappingViews:
    """Views of one picture that overlap, with exact correspondences."""

    name: str
    clusters: Int[Tensor, "v y x"]
    """Labels of corresponding cells of the result; -1: in no other view."""
    schedule: Schedule
    """Noise schedule of the editor."""
    edit: Callable[[SamplerSettings, int], Float[Tensor, "v ..."]]
    """The edited views, [v h w c], for settings and a seed; the unedited ones are zero."""

    def disagreement(self, views: Float[Tensor, "v h w c"]) -> float:
        """RMS difference of corresponding cells from their mean."""
        return rms(self._differences(views))

    def deviation(self, views: Float[Tensor, "v h w c"], alone: Float[Tensor, "v h w c"]) -> float:
        """The signed share of the disagreement of views sampled `alone` that is left in `views`.

        1 where nothing was won, 0 in agreement, negative beyond it: the differences from the mean,
        projected on what they were.
        """
        before = self._differences(alone).double()
        after = self._differences(views).double()
        return float((after * before).sum() / before.square().sum())

    def _differences(self, views: Float[Tensor, "v h w c"]) -> Float[Tensor, "m p"]:
        """Corresponding cells less the mean of their cluster; `m` cells of `p` numbers."""
        flat, labels = views.flatten(0, 2), self.clusters.flatten()
        shared = labels >= 0
        flat, labels = flat[shared], labels[shared].long()
        count = int(labels.max()) + 1
        total = flat.new_zeros(count, flat.shape[1]).index_add(0, labels, flat)
        members = labels.bincount(minlength=count).clamp_min(1)
        mean = total / members[:, None]
        return flat - mean[labels]


def crops(views: int, side: int, shift: int) -> Int[Tensor, "v y x"]:
    """Clusters of views that each look `shift` cells further along both axes than the last."""
    y, x = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    wide = side + views * shift
    places = torch.stack([(y + v * shift) * wide + x + v * shift for v in range(views)])
    _, names, counts = places.unique(return_inverse=True, return_counts=True)
    return torch.where(counts[names] > 1, names, -1)


def texture_views(side: int = 24, shift: int = 2) -> OverlappingViews:
    """A texture: x0 is normal about a mean of each view's own, with the data's unit variance.

    Averaging blurs it: no component of the data pulls the result back, so lost contrast stays lost.
    """
    labels = crops(VIEWS, side, shift)
    shape = (VIEWS, 1, side, side)
    bias = 0.3 * torch.randn(shape, generator=torch.Generator().manual_seed(7))
    model = Texture(bias)

    def edit(settings: SamplerSettings, seed: int) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        share = partial(share_noise, labels=labels) if settings.noise == "shared" else None
        noise = torch.randn(shape, generator=generator)
        first = levels_of(model.schedule, settings)[0]
        x = add_noise(torch.zeros(shape), share(noise) if share else noise, first)
        *_, state = sample(
            model, None, x, settings,
            consensus=partial(consensus, labels=labels, strength=settings.consensus_weight),
            share=share, generator=generator,
        )  # fmt: skip
        return state.x.movedim(1, -1)

    return OverlappingViews("texture", labels, model.schedule, edit)


@dataclass(frozen=True, eq=False)
class Texture:
    """A Predictor: under every condition x0 is normal about `bias` with unit variance."""

    bias: Float[Tensor, "v 1 y x"]
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "x0"
    name: str = "texture"

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        level = self.schedule.level(t)
        x0 = self.bias + level.a / (level.a**2 + level.b**2) * (x - level.a * self.bias)
        return Branches(*(x0 if needed else None for needed in need))
