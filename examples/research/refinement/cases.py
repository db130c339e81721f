"""Edits at the limits, each with the reason why it is here: all end finite, or are refused.

The 2D editor needs no network: it exchanges red and blue, or does what the case says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import log, nan
from unittest import mock

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import Dataset, capture
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editing.session.settings import EditSettings
from gsedit.editor_protocol import Capabilities, EditBatch, EditProgress
from gsedit.fitting import update
from gsedit.fitting.settings import UpdateSettings
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from rasterizer.scene import Gaussians

Pictures = Float[Tensor, "v h w 3"]
Change = Callable[[Pictures, torch.Generator], Tensor]

SIZE = 48
"""Pixels of the views."""


@dataclass(frozen=True, eq=False)
class Editor:
    """A 2D editor that answers with a change of the unedited pictures."""

    change: Change
    name: str = "changed"
    cell: int = 8
    capabilities: Capabilities = field(default_factory=Capabilities)

    def check(self, prompt: str) -> None:
        """Any instruction will do."""

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """All in one step."""
        yield EditProgress(1, 1, self.change(batch.originals, generator))


@dataclass(frozen=True, eq=False)
class Case:
    """One edit, and what is extreme about it."""

    name: str
    why: str
    scene: Callable[[Gaussians], Gaussians] = lambda scene: scene
    """Function that changes the ordinary scene."""
    change: Change = lambda pictures, generator: pictures.flip(-1)
    gaussians: int = 600
    views: int = 9
    geometry: bool = True
    """Whether shapes move too."""
    rates: float = 1.0
    """Factor of all learning rates."""
    refused: str | None = None
    """Part of the message with which it is refused; None: it ends."""
    long: bool = False
    """Whether it takes minutes, and is left out of a quick run."""

    def make(self) -> tuple[Gaussians, Dataset]:
        """The scene, and renders of it from a ring."""
        scene = surface_gaussians(demo_scene(), self.gaussians, torch.Generator().manual_seed(0))
        cameras = ring_cameras(demo_scene(), self.views, SIZE)
        scene = self.scene(scene)
        names = [f"{i:04d}" for i in range(self.views)]
        return scene, Dataset(capture(scene, cameras, names))

    def settings(self) -> EditSettings:
        """A short edit of the kind."""
        return EditSettings(
            update=UpdateSettings(patches=2, patch=32),
            batches=2,
            geometry="full" if self.geometry else "appearance",
            held_out_edits=0,
            region="all",
        )


def scaled_rates(factor: float) -> mock._patch_dict:
    """A context in which colors and opacities learn so many times faster."""
    rates = {name: factor * rate for name, rate in update.APPEARANCE_RATES.items()}
    return mock.patch.dict(update.APPEARANCE_RATES, rates)


def _needles(scene: Gaussians) -> Gaussians:
    """Every tenth is 1000 times as long as wide."""
    scales = scene.log_scales.clone()
    scales[::10, 0] += log(30)
    scales[::10, 1:] -= log(33)
    return replace(scene, log_scales=scales)


def _specks(scene: Gaussians) -> Gaussians:
    return replace(scene, log_scales=scene.log_scales - log(1e6))


def _far(scene: Gaussians) -> Gaussians:
    """Seen from ten thousand times as far as the cameras are."""
    means = scene.means + torch.tensor([0.0, 0.0, 1e4])
    return replace(scene, means=means)


def _opaque(scene: Gaussians) -> Gaussians:
    return replace(scene, logit_opacities=torch.full_like(scene.logit_opacities, 50.0))


def _broken(scene: Gaussians) -> Gaussians:
    means = scene.means.clone()
    means[57, 1] = nan
    return replace(scene, means=means)


def _noise(pictures: Pictures, generator: torch.Generator) -> Pictures:
    return torch.rand(pictures.shape, generator=generator)


def _not_a_number(pictures: Pictures, generator: torch.Generator) -> Pictures:
    pictures = pictures.clone()
    pictures[0, 3, 5] = nan
    return pictures


def _small(pictures: Pictures, generator: torch.Generator) -> Tensor:
    return pictures[:, ::2, ::2]


CASES = (
    Case("ordinary", "what the others compare to"),
    Case("needles", "every tenth Gaussian is 1000 times as long as wide", _needles),
    Case("specks", "Gaussians of a millionth of their size: less than a pixel", _specks),
    Case("opaque", "logit 50: opacities are 1, and without gradient", _opaque),
    Case("far-off camera", "the scene is 1e4 away: a view sees nothing, or a pixel", _far,
         refused="no camera sees any of the scene"),
    Case("broken scene", "one position is NaN", _broken, refused="means[57, 1] is nan"),
    Case("rates x 10", "colors and opacities learn ten times as fast", rates=10.0),
    Case("rates x 1000", "and a thousand times as fast", rates=1000.0),
    Case("target of NaN", "one pixel of one answer of the editor", change=_not_a_number,
         refused="are not finite numbers"),
    Case("target of 1e30", "an editor without a last clamp: 1 is the brightest",
         change=lambda pictures, generator: 1e30 * pictures),
    Case("target of another size", "an editor that forgets the size", change=_small,
         refused="of another size"),
    Case("black target", "nothing to see, and Gram matrices of 0",
         change=lambda pictures, generator: torch.zeros_like(pictures)),
    Case("white target", "the brightest", change=lambda p, generator: torch.ones_like(p)),
    Case("noise", "an editor that returns noise: views agree on nothing", change=_noise),
    Case("nothing changed", "an editor that returns what it was given",
         change=lambda pictures, generator: pictures),
    Case("one view", "none is held out, none to agree with", views=1),
    Case("two views", "one is held out", views=2),
    Case("10 Gaussians", "fewer than any list or sample is long", gaussians=10),
    Case("1 Gaussian", "the fewest", gaussians=1),
    Case("1000 views", "the survey looks at all", views=1000, geometry=False, long=True),
    Case("1e6 Gaussians", "500 to a pixel", gaussians=1_000_000, geometry=False, long=True),
)  # fmt: skip
