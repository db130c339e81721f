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

from gsedit.consistency.consensus import consensus, share_noise
from gsedit.consistency.correspond import Correspondences
from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.sampler import add_noise, levels_of, sample
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import EditBatch
from gsedit.editors.closed_form import CELL_PIXELS, ClosedForm
from gsedit.editors.sampling import DiffusionEditor
from research.sampler.measurements import rms

VIEWS = 4


@dataclass(frozen=True, eq=False)
class OverlappingViews:
    """Views of one picture that overlap, with exact correspondences."""

    name: str
    originals: Float[Tensor, "v ..."]
    clusters: Int[Tensor, "v y x"]
    """Labels of corresponding cells of the result; -1: in no other view."""
    cell: int
    """Pixels of the result per cell."""
    schedule: Schedule
    """Noise schedule of the editor."""
    edit: Callable[[SamplerSettings, int], Float[Tensor, "v ..."]]
    """The edited views, [v h w c], for settings and a seed."""

    def disagreement(self, views: Float[Tensor, "v h w c"]) -> float:
        """RMS difference of corresponding pixels from their mean."""
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
        side = self.cell
        cells = views.unfold(1, side, side).unfold(2, side, side).flatten(3)  # v y x (c s s)
        flat, labels = cells.flatten(0, 2), self.clusters.flatten()
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

    return OverlappingViews(
        "texture", torch.zeros(shape).movedim(1, -1), labels, 1, model.schedule, edit
    )


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


PROMPT = "turn it into bronze"


def picture_views(
    side: int = 12, shift: int = 1, denoiser: ClosedForm | None = None
) -> OverlappingViews:
    """Crops of one painted picture, edited by the closed-form editor (None: as it is by default),
    which perturbs light, tint and place of each view as 2D editors do.
    """
    cell, wide = CELL_PIXELS, side + VIEWS * shift
    labels = crops(VIEWS, side, shift)
    y, x = torch.meshgrid(torch.arange(wide * cell), torch.arange(wide * cell), indexing="ij")
    waves = [torch.sin(x / 9 + 0.7), torch.sin(y / 7 + x / 31), torch.sin((x + y) / 5)]
    full = torch.stack(waves, -1) * 0.25 + 0.5
    step = shift * cell
    views = torch.stack(
        [full[v * step :, v * step :][: side * cell, : side * cell] for v in range(VIEWS)]
    )
    editor = DiffusionEditor(denoiser or ClosedForm())
    matches = Correspondences(labels, torch.ones(VIEWS, VIEWS), cell)

    def edit(settings: SamplerSettings, seed: int) -> Tensor:
        batch = EditBatch(views, views, PROMPT, matches, None, seed)
        *_, progress = editor.edit(batch, settings, torch.Generator().manual_seed(seed))
        assert progress.images is not None
        return progress.images

    return OverlappingViews("closed form", views, labels, cell, editor.denoiser.schedule, edit)
