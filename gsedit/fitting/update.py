"""How a scene follows its edited views: the single-pass update of Efficient-NeRF2NeRF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.measures.features import FeatureExtractor
from gsedit.measures.losses import edit_loss
from gsedit.views.dataset import View
from rasterizer.numerics import AUTO, Execution
from rasterizer.project import Box
from rasterizer.render import render

APPEARANCE_RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3}
"""Colours learn ten times faster than in a fit from photos: an edit has 200 steps a round."""
GEOMETRY_RATES = {"log_scales": 2e-3, "quats": 1e-3}
MEANS_RATE = 1.6e-4
"""Times the scene's radius (Kerbl et al.)."""
FINAL_RATE = 0.05
"""Rates fall linearly to this fraction in each round: its last steps average, not chase."""

SMALLEST_PATCH = 16
"""Pixels a side: the coarsest filters under the Gram matrix reach this far."""


@dataclass(frozen=True)
class UpdateSettings:
    """One round of fitting to the edited views."""

    steps: int = 200
    """N_SU of the paper."""
    patches: int = 4
    """Crops rendered a step."""
    patch: int = 64
    """Side of a crop, pixels."""
    gram_weight: float = 0.1
    """lambda of eq. (loss)."""

    def __post_init__(self) -> None:
        if self.steps < 1 or self.patches < 1 or self.patch < SMALLEST_PATCH:
            raise UsageError(
                f"update steps and patches must be 1 or more, and a patch {SMALLEST_PATCH} pixels "
                f"or more, not {self.steps}, {self.patches} and {self.patch}"
            )
        if not self.gram_weight >= 0:
            raise UsageError(f"gram weight {self.gram_weight} is not 0 or more")


def rates(geometry: str, radius: float) -> dict[str, float]:
    """Learning rates of a preset: `appearance` (colours, opacities) or `full` (everything)."""
    if geometry == "appearance":
        return dict(APPEARANCE_RATES)
    return {**APPEARANCE_RATES, **GEOMETRY_RATES, "means": MEANS_RATE * radius}


def update_steps(
    optimiser: SceneOptimiser,
    targets: Sequence[View],
    seen: Bool[Tensor, " n"],
    settings: UpdateSettings,
    features: FeatureExtractor,
    generator: torch.Generator,
    execution: Execution = AUTO,
) -> Iterator[float]:
    """Fit the scene to random patches of the edited views; yields the loss of every step.

    Only the Gaussians that are `seen` move.
    """
    for step in range(settings.steps):
        scene = optimiser.scene
        drawn = [_patch(targets, settings.patch, generator) for _ in range(settings.patches)]
        found = torch.stack(
            [render(scene, v.camera, crop=box, execution=execution).color for v, box in drawn]
        )
        wanted = torch.stack([_cut(v.image, box) for v, box in drawn])
        loss = edit_loss(found, wanted, features, settings.gram_weight)
        loss.backward()
        optimiser.step(1 - (1 - FINAL_RATE) * step / max(1, settings.steps - 1), only=seen)
        yield loss.item()


def _patch(targets: Sequence[View], side: int, generator: torch.Generator) -> tuple[View, Box]:
    """A random crop of a random view; the whole side where the picture is smaller."""
    view = targets[int(torch.randint(len(targets), (), generator=generator))]
    smallest = min(min(v.camera.width, v.camera.height) for v in targets)
    side = min(side, smallest)
    left = int(torch.randint(view.camera.width - side + 1, (), generator=generator))
    top = int(torch.randint(view.camera.height - side + 1, (), generator=generator))
    return view, (left, top, side, side)


def _cut(image: Tensor, box: Box) -> Tensor:
    left, top, width, height = box
    return image[top : top + height, left : left + width]
