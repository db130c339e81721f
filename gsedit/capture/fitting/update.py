"""Fit a scene to edited views, on random patches (Efficient-NeRF2NeRF)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.capture.fitting.edit_loss import edit_loss
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.photometric import supervised
from gsedit.capture.fitting.random_crops import cut, random_patch, share_of_crops, shown_at
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.measures.features import FeatureExtractor
from gsedit.run.step_threads import StepThreads
from gsedit.views.dataset import View
from rasterizer.numerics import Numerics
from rasterizer.project import Box
from rasterizer.render import render

FELT = Numerics(gradient_min=1 / 1024)
"""Gaussians whose weight in a pixel is below 1/1024 get no gradient from it: all of them together
are 0.1 to 0.2 % of the bear's pictures, and half of what the backward pass would visit."""
APPEARANCE_RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3}
"""Colors learn ten times faster than in 3D Gaussian splatting (2.5e-3, Kerbl et al. 2023): an edit
has a few hundred steps."""
GEOMETRY_RATES = {"log_scales": 2e-3, "quats": 1e-3}
MEANS_RATE = 1.6e-4
"""Times the scene's radius (Kerbl et al.)."""
FINAL_RATE = 0.05
"""Rates fall linearly to this fraction in each round: its last steps average, not chase."""

COARSE_SIZE = 192
"""Pixels. A crop of a large view shows little of the scene, so that most steps are fitted to views
of this longer side up to twice as many pixels."""
COARSE_SHARE = 0.75
"""Share of the steps that run first, before those at full size. On views of 1024 pixels, colors end
6 dB nearer to a known edit than at full size throughout (docs/measurements/editing.md)."""


def rates(geometry: Literal["appearance", "full"], radius: float) -> dict[str, float]:
    """Learning rates by field: of colors and opacities (`appearance`), or of everything (`full`).

    `radius` of the scene, world units: positions move in proportion to it.
    """
    if geometry == "appearance":
        return dict(APPEARANCE_RATES)
    return {**APPEARANCE_RATES, **GEOMETRY_RATES, "means": MEANS_RATE * radius}


@dataclass(frozen=True, eq=False)
class Target:
    """An edited view, and what the update needs of it: made once while it stays as it is."""

    view: View
    shown: Bool[Tensor, "h w"] | None = None
    """Pixels that show the region: patches hold such a pixel. None: all, of every view."""
    patch: int = UpdateSettings.patch
    """Side of a patch, pixels."""

    @cached_property
    def share(self) -> float:
        """The probability that a random patch holds a pixel that is shown."""
        return 1.0 if self.shown is None else share_of_crops([self.shown], self.patch)

    @cached_property
    def small(self) -> View:
        """The copy that the first steps of a round use."""
        return coarse(self.view)

    @cached_property
    def small_shown(self) -> Bool[Tensor, "y x"] | None:
        """`shown`, in the small copy."""
        camera = self.small.camera
        return None if self.shown is None else shown_at(self.shown, camera.width, camera.height)


def update_steps(
    optimizer: SceneOptimizer,
    targets: Sequence[Target],
    seen: Bool[Tensor, " n"],
    span: range,
    steps: int,
    settings: UpdateSettings,
    features: FeatureExtractor,
    generator: torch.Generator,
) -> Iterator[float]:
    """Fit the scene to random patches of the edited views; yields the loss of every step.

    These are the steps `span` of a round of `steps`. Only the Gaussians that are `seen` move; their
    negative base colors are raised before the round's first step. The learning rates fall linearly
    over the round. Of large targets, the first steps use smaller copies. Where the targets say what
    is shown of a region, the patches are those in which it shows.
    """
    threads = StepThreads()
    if span.start == 0:
        optimizer.raise_negative_colors(seen)
    for step in span:
        if step < COARSE_SHARE * steps:
            views, shown = [t.small for t in targets], [t.small_shown for t in targets]
        else:
            views, shown = [t.view for t in targets], [t.shown for t in targets]
        masks = [mask for mask in shown if mask is not None] or None
        patches = [
            random_patch(views, masks, settings.patch, generator) for _ in range(settings.patches)
        ]
        with threads.step():
            drawn = [
                render(optimizer.scene, v.camera, crop=box, numerics=FELT) for v, box in patches
            ]
            rendered = torch.stack([each.color for each in drawn])
            expected = torch.stack([cut(v.image, box) for v, box in patches])
            rendered, expected = supervised(rendered, expected, _masks_of(patches))
            loss = edit_loss(rendered, expected, settings.terms_at(step), features)
            loss.backward()
            optimizer.step(rate_scale(step, steps), only=seen)
        yield loss.item()


def _masks_of(patches: Sequence[tuple[View, Box]]) -> Bool[Tensor, "b y x"] | None:
    """The masks of views in the patches; None where no view has one."""
    views = {id(view): view for view, _ in patches}.values()
    masks = {id(view): view.mask for view in views}
    if all(mask is None for mask in masks.values()):
        return None
    everywhere = torch.ones(1, 1, dtype=torch.bool)
    whole = [everywhere.expand(height, width) for _, (_, _, width, height) in patches]
    return torch.stack(
        [
            every if (mask := masks[id(view)]) is None else cut(mask, box)
            for (view, box), every in zip(patches, whole)
        ]
    )


def rate_scale(step: int, steps: int) -> float:
    """Factor of the learning rates at this step of a round: from 1 to FINAL_RATE."""
    return 1 - (1 - FINAL_RATE) * step / max(1, steps - 1)


def coarse(view: View) -> View:
    """The view halved until its longer side is below twice COARSE_SIZE; itself where it is."""
    size = max(view.camera.width, view.camera.height)
    factor = 1
    while size // (2 * factor) >= COARSE_SIZE:
        factor *= 2
    if factor == 1:
        return view
    width, height = (max(1, side // factor) for side in (view.camera.width, view.camera.height))
    return view.resized(width, height)
