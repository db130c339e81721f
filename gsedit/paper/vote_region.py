"""The region of an edit, voted by edited views: where nothing else tells it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.select.region import Region, everything, find_changed, lift
from rasterizer.camera import Camera
from rasterizer.numerics import Execution
from rasterizer.scene import Gaussians


def vote_region(
    scene: Gaussians,
    cameras: Sequence[Camera],
    edited: Mapping[int, Float[Tensor, "h w 3"]],
    originals: Mapping[int, Float[Tensor, "h w 3"]],
    execution: Execution,
) -> Region:
    """The region that the editor changed, voted over the edited views.

    `cameras` are those of all views; `edited` and `originals` are pictures by index.
    """
    changes = [_change(image, originals[i]) for i, image in edited.items()]
    lifted = lift(scene, [cameras[i] for i in edited], changes, execution)
    inside = find_changed(scene, lifted)
    if inside is None:
        return Region(everything(scene).inside, "auto: the edit is of the whole scene")
    return Region(inside, "auto: what the edit changes")


def _change(
    edited: Float[Tensor, "h w 3"], original: Float[Tensor, "h w 3"]
) -> Float[Tensor, "h w"]:
    """The root mean square over the channels of the difference."""
    return torch.sqrt((edited - original).square().mean(-1))
