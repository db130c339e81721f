"""More Gaussians where pictures disagree most, fewer where nothing shows (Kerbl et al. 2023)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.fitting.settings import FitSettings
from rasterizer.camera import Camera
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians, concatenate

SPLIT_SHRINK = 1.6
"""The two halves of a Gaussian are this many times smaller (Kerbl et al. 2023, section 5.2)."""


class Densified(NamedTuple):
    """A scene after densification. `n` Gaussians, of it."""

    scene: Gaussians
    origin: Int[Tensor, " n"]
    """The row of the scene before that each came from."""
    fresh: Bool[Tensor, " n"]
    """Whether it is new: one half of a divided Gaussian."""


class ScreenGradients:
    """Mean positional gradient of each Gaussian, as seen on screen. Grows with every picture."""

    def __init__(self, count: int) -> None:
        self.total, self.pictures = torch.zeros(count), torch.zeros(count)

    def state(self) -> dict[str, Tensor]:
        """What was counted; not a copy."""
        return {"total": self.total, "pictures": self.pictures}

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on counting where another was."""
        self.total, self.pictures = state["total"].clone(), state["pictures"].clone()

    @torch.no_grad()
    def add(self, gradient: Float[Tensor, "n 3"], scene: Gaussians, camera: Camera) -> None:
        """Count the gradient of the positions in one picture, where there is one."""
        # d/d(pixel) is d/d(world) times depth over focal length; counted per half picture, as
        # INRIA does
        pose = camera.world_to_camera.to(scene.means)
        depth = scene.means @ pose[2, :3] + pose[2, 3]
        size = gradient.norm(dim=-1) * depth.abs() / camera.fx * (camera.width / 2)
        self.total += size
        self.pictures += size > 0

    def include(self, other: ScreenGradients) -> None:
        """Count the pictures of another, of the same Gaussians."""
        self.total += other.total
        self.pictures += other.pictures

    @property
    def mean(self) -> Float[Tensor, " n"]:
        """Over the pictures in which the Gaussian had a gradient; 0 if there were none."""
        return self.total / self.pictures.clamp_min(1)


@torch.no_grad()
def densify(
    scene: Gaussians,
    gradients: Float[Tensor, " n"],
    settings: FitSettings,
    generator: torch.Generator,
) -> Densified:
    """Remove what is transparent and divide what has the largest positional gradients.

    A dividing Gaussian becomes two, drawn from itself and 1.6 times smaller (Kerbl et al., split);
    both have the opacity that together looks like the one: 1 - sqrt(1 - o).
    """
    alive = scene.opacities > min(settings.prune_opacity, float(scene.opacities.max()) / 2)
    room = max(0, settings.max_gaussians - int(alive.sum()))
    count = min(room, int(settings.densify_fraction * int(alive.sum())))
    strongest = torch.where(alive, gradients, -1.0).topk(count).indices
    halves = [_half(scene[strongest], generator) for _ in range(2)]
    alive[strongest] = False
    kept = alive.nonzero().squeeze(-1)
    origin = torch.cat((kept, strongest, strongest))
    fresh = torch.arange(len(origin)) >= len(kept)
    return Densified(concatenate(scene[kept], *halves), origin, fresh)


def _half(parents: Gaussians, generator: torch.Generator) -> Gaussians:
    """One of the two that each becomes, drawn from it."""
    rotation = rotation_matrices(parents.quats)
    draw = torch.randn(len(parents), 3, generator=generator) * parents.scales
    opacity = 1 - (1 - parents.opacities.clamp_max(0.999)).sqrt()
    return replace(
        parents,
        means=parents.means + (rotation @ draw[:, :, None]).squeeze(-1),
        log_scales=parents.log_scales - torch.log(torch.tensor(SPLIT_SHRINK)),
        logit_opacities=torch.logit(opacity),
    )
