"""The sampler as an editor: what it pads and crops, and what it forwards of its denoiser."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
import torch.nn.functional as F

from gsedit.paper.consistency.correspond import Correspondences
from gsedit.paper.diffusion.guidance import Branches
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.editors import Capabilities, EditBatch
from gsedit.paper.editors.sampling import DiffusionEditor, padded
from gsedit.paper.settings import PRESETS

CELL = 2
SD = Schedule.scaled_linear()
DECLARED = Capabilities(defaults=SamplerDefaults(3.0, 1.0, 0.5))


@dataclass(frozen=True, eq=False)
class Unchanged:
    """A denoiser of cells of 2 that wants sides of 8, and whose edit is the unedited picture."""

    name: str = "unchanged"
    cell: int = CELL
    multiple: int = 8
    padding: str = "mirror"
    predicts: str = "x0"
    schedule: Schedule = SD
    capabilities: Capabilities = DECLARED

    def check(self, prompt: str) -> None: ...

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        assert all(side % self.multiple == 0 for side in images.shape[1:3])
        return F.pixel_unshuffle(images.movedim(-1, 1), CELL)

    def encode_edited(self, images: Any, originals: Any, prompt: str) -> torch.Tensor:
        return self.encode(images)

    def decode(self, latents: torch.Tensor) -> torch.Tensor:
        return F.pixel_shuffle(latents, CELL).movedim(1, -1)

    def condition(self, originals: Any, prompt: str, generator: Any) -> torch.Tensor:
        return self.encode(originals)

    def branches(self, x: torch.Tensor, t: float, condition: torch.Tensor, need: Any) -> Branches:
        return Branches(*(condition if needed else None for needed in need))


def ramps(height: int, width: int) -> torch.Tensor:
    """Red grows along x, green along y: a shift by any part of a pixel changes every value."""
    y, x = torch.meshgrid(torch.arange(height) / height, torch.arange(width) / width, indexing="ij")
    return torch.stack((x, y, x * y), -1)[None].repeat(2, 1, 1, 1)


def cells(rows: int, columns: int) -> Correspondences:
    """Every cell of two views corresponds to the one at the same place."""
    labels = torch.arange(rows * columns).reshape(1, rows, columns).repeat(2, 1, 1)
    return Correspondences(labels, torch.ones(2, 2), CELL)


class Watched(Unchanged):
    """A denoiser that keeps the latents of its first evaluation."""

    def branches(self, x: torch.Tensor, t: float, condition: torch.Tensor, need: Any) -> Branches:
        self.__dict__.setdefault("first", x)
        return super().branches(x, t, condition, need)


@pytest.mark.parametrize("strength", [0.98, 1.0])
def test_at_strength_1_sampling_starts_from_noise_alone(strength):
    """On this schedule the last level would keep 7.6 % of the render."""
    starts = []
    for images in (ramps(16, 16), 1 - ramps(16, 16)):
        denoiser, settings = Watched(), PRESETS["paper"].settings.sampler
        batch = EditBatch(images, ramps(16, 16), "x")
        generator = torch.Generator().manual_seed(0)
        list(DiffusionEditor(denoiser).edit(batch, replace(settings, strength=strength), generator))
        starts.append(denoiser.__dict__["first"])
    noise = torch.randn(starts[0].shape, generator=torch.Generator().manual_seed(0))
    assert torch.equal(*starts) == torch.equal(starts[0], noise) == (strength == 1)


@pytest.mark.parametrize(("height", "width"), [(16, 24), (17, 24), (31, 1), (3, 50), (1, 1)])
def test_padding_and_cropping_move_nothing(height, width):
    images = ramps(height, width)
    rows, columns = -(-height // CELL), -(-width // CELL)
    request = EditBatch(images, images, "x", cells(rows, columns))
    settings = SamplerSettings(steps=2, solver="euler", guidance_text=1.0)
    *_, last = DiffusionEditor(Unchanged()).edit(request, settings, torch.Generator())
    assert torch.equal(last.images, images)  # not a rounding: no pixel was interpolated
    whole = padded(request, Unchanged())
    assert all(side % 8 == 0 for side in whole.originals.shape[1:3])
    # where they were: cell (i, j) holds the same pixels, so correspondences still hold
    assert torch.equal(whole.originals[:, :height, :width], images)
    labels = whole.correspondences.labels
    assert labels.shape == (2, whole.originals.shape[1] // 2, whole.originals.shape[2] // 2)
    assert torch.equal(labels[:, :rows, :columns], request.correspondences.labels)
    assert (labels[:, rows:] == -1).all()
    assert (labels[:, :, columns:] == -1).all()
