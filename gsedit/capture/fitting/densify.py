"""More Gaussians where pictures disagree most, fewer where nothing shows (Kerbl et al. 2023); and
pieces of large ones, since patterns that are finer than the Gaussians of a scene cannot appear.

`n` Gaussians before, `m` after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import log, sqrt
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.run.state import tensor_like
from gsedit.run.step_threads import on_threads
from rasterizer.camera import Camera
from rasterizer.project import rotation_matrices
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

MOST_DIVIDED = 0.1
"""Largest share of the Gaussians that divides each time: of the largest positional gradients."""
PRUNED_OPACITY = 0.005
"""Opacity below which a Gaussian is removed: an 8-bit picture hardly shows it."""
DECAY = 0.004
"""Opacity subtracted from every Gaussian each time; training restores what the photos need."""
SPLIT_OFFSET = 0.75
"""The two halves of a Gaussian lie so many standard deviations off its center, along its longest
axis, and are shorter there by as much as leaves the second moment of both together what it was."""
SPLIT_LENGTH = sqrt(1 - SPLIT_OFFSET**2)
"""Length of a half along that axis, in lengths of the whole."""
LONG, MOST_LONG = 1.15, 8.0
"""Times the wanted length of its longest axis from which a Gaussian is divided, and from which it
is no more urgent."""
MOST_HALVINGS = 8
"""Times that a Gaussian is halved: a flat one is then a fifth as long on both axes."""
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
        _, depth, inside = camera.pictured(scene.means)
        kept &= ~(inside & (depth < nearest))
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


@torch.no_grad()
def divided(
    scene: Gaussians, longest: Float[Tensor, " n"], worth: Float[Tensor, " n"], most: int
) -> tuple[Gaussians, Int[Tensor, " m"]]:
    """Divide Gaussians until no axis is much longer than `longest` (standard deviation, world
    units; 0: none), or there are `most`; those of the greatest `worth` and length first.

    Returns the scene, whose pictures change little, and the row before of each Gaussian.
    """
    origin = torch.arange(len(scene))
    for _ in range(MOST_HALVINGS):
        ratio = torch.where(longest > 0, scene.scales.amax(-1) / longest, 0.0)
        urgent = torch.where(ratio > LONG, worth * (ratio.clamp_max(MOST_LONG) - 1), 0.0)
        count = min(most - len(scene), int((urgent > 0).sum()))
        if count <= 0:
            break
        picked = urgent.topk(count).indices
        kept = torch.ones(len(scene), dtype=torch.bool).index_fill(0, picked, False)
        rows = torch.cat((kept.nonzero().squeeze(-1), picked, picked))
        scene = concatenate(scene[rows[: -2 * count]], *halved(scene[picked]))
        worth = torch.where(kept, worth, worth / 2)[rows]
        longest, origin = longest[rows], origin[rows]
    return scene, origin


def halved(parents: Gaussians) -> tuple[Gaussians, Gaussians]:
    """Two for each, along its longest axis: together they have its mass (the integral of its
    opacity), mean and covariance."""
    longest, axis = parents.scales.max(-1)
    rotation = rotation_matrices(parents.quats)
    direction = rotation.gather(2, axis[:, None, None].expand(-1, 3, 1)).squeeze(-1)
    offset = SPLIT_OFFSET * longest[:, None] * direction
    shorter = torch.nn.functional.one_hot(axis, 3) * log(SPLIT_LENGTH)
    opacity = parents.opacities / (2 * SPLIT_LENGTH)
    half = replace(
        parents, log_scales=parents.log_scales + shorter, logit_opacities=torch.logit(opacity)
    )
    return replace(half, means=half.means - offset), replace(half, means=half.means + offset)
