"""More Gaussians where pictures disagree most, fewer where nothing shows (Kerbl et al. 2023)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.run.state import tensor_like
from gsedit.run.step_threads import on_threads
from gsedit.scene.dividing import halved
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

MOST_DIVIDED = 0.1
"""Largest share of the Gaussians that divides each time: of the largest positional gradients."""
PRUNED_OPACITY = 0.005
"""Opacity below which a Gaussian is removed: an 8-bit picture hardly shows it."""
DECAY = 0.004
"""Opacity subtracted from every Gaussian each time; training restores what the photos need."""
NEAR_SHARE = 0.5
"""Share of the depth at which a camera's picture begins, nearer than which a Gaussian is a floater:
photos are taken from where nothing stands between the camera and the scene."""
PICTURE_BEGINS = 0.02
"""Share of a picture's pixels that are nearer than where it begins: a thing that really stands
there fills more."""


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
        """Return what was counted, without a copy."""
        return {"total": self.total, "pictures": self.pictures}

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on counting where another was."""
        self.total = tensor_like(state, "total", self.total)
        self.pictures = tensor_like(state, "pictures", self.pictures)

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
@on_threads(1)  # the last digits of torch's sigmoid depend on where a thread's part ends
def densify(
    scene: Gaussians, gradients: Float[Tensor, " n"], target: int, most: float = MOST_DIVIDED
) -> Densified:
    """Lower all opacities, remove what is transparent, divide what has the largest gradients.

    Opacities fall by DECAY, and by half at most (`faded`). So many divide that there are `target`
    Gaussians, if they are at most the share `most` of them. A dividing Gaussian becomes two along
    its longest axis, which together have its mass (the integral of its lowered opacity), mean and
    covariance: the pictures change little.
    """
    scene = faded(scene)
    alive = scene.opacities > min(PRUNED_OPACITY, float(scene.opacities.max()) / 2)
    before = int(alive.sum())
    count = max(0, min(target - before, int(most * before)))
    strongest = torch.where(alive, gradients, -1.0).topk(count).indices
    halves = halved(scene[strongest])
    alive[strongest] = False
    kept = alive.nonzero().squeeze(-1)
    origin = torch.cat((kept, strongest, strongest))
    fresh = torch.arange(len(origin)) >= len(kept)
    return Densified(concatenate(scene[kept], *halves), origin, fresh)


@torch.no_grad()
def without_floaters(scene: Gaussians, cameras: Sequence[Camera]) -> Densified:
    """Remove what hangs before a camera: what no photo contradicts, since only that one sees it.

    Each camera's picture begins at the depth that PICTURE_BEGINS of its median depths are below;
    what it shows nearer than NEAR_SHARE of that is removed. Small cameras do.
    """
    kept = torch.ones(len(scene), dtype=torch.bool)
    for camera in cameras:
        depths = render(scene, camera, median_depth=True).median_depth
        assert depths is not None
        if not (seen := depths[depths > 0]).numel():
            continue
        nearest = NEAR_SHARE * seen.quantile(PICTURE_BEGINS)
        places, depth = camera.project(scene.means)
        size = places.new_tensor((camera.width, camera.height))
        inside = ((places >= 0) & (places < size)).all(-1)
        kept &= ~(inside & (depth > 0) & (depth < nearest))
    origin = kept.nonzero().squeeze(-1)
    return Densified(scene[origin], origin, torch.zeros_like(origin, dtype=torch.bool))


def faded(scene: Gaussians, decay: float = DECAY) -> Gaussians:
    """The scene with every opacity lower by `decay`, or by half where that is less.

    What no photo raises again becomes transparent, and what is removed makes room for more where
    the pictures disagree: as brush does, and instead of the resets of Kerbl et al.
    """
    opacities = torch.maximum(scene.opacities - decay, scene.opacities / 2)
    # an opacity of 1, which a tiny decay rounds to, has no finite logit
    logits = torch.minimum(scene.logit_opacities, torch.logit(opacities))
    return replace(scene, logit_opacities=logits)
