"""What the quantised formats share: opacities of 8 bits, and gsply, which unpacks two of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from gsedit.errors import InputError, UsageError
from gsedit.files.inria import from_gsply
from rasterizer.scene import Gaussians

LOGIT_MAX = 15.0
"""These formats store opacity in 8 bits, and 255 means 1, whose logit is infinite. The sigmoid of
15 is 1 - 3e-7: about the largest logit at which float32 still has a gradient."""


def finite_logits(scene: Gaussians) -> Gaussians:
    """The scene with the logits of its opacities between -LOGIT_MAX and LOGIT_MAX."""
    return replace(scene, logit_opacities=scene.logit_opacities.clamp(-LOGIT_MAX, LOGIT_MAX))


def unpacked(path: Path, read: Callable[[], Any]) -> Gaussians:
    """The scene that gsply reads from a file. Raises InputError for a damaged one."""
    try:
        return finite_logits(from_gsply(read()))
    except (ValueError, MemoryError, OverflowError, KeyError, IndexError) as error:
        reason = str(error).split("\n")[0].removesuffix(f": {path}")
        if "zstandard" in reason:
            move = "run `pip install zstandard`, or save it as SPZ version 3"
            raise InputError(f"{path} is SPZ version 4: {move}") from None
        raise InputError(f"{path} cannot be unpacked ({reason}): export it again") from None


def to_gsply(scene: Gaussians, path: Path) -> Any:
    """The scene as gsply writes it. Raises UsageError above SH degree 3."""
    from gsply import GSData

    if scene.degree > 3:
        raise UsageError(f"{path}: SH degree {scene.degree} does not fit: reduce it to 3 first")
    quats = torch.nn.functional.normalize(scene.quats, dim=1)  # smallest-three packing needs it
    fields = (scene.means, scene.log_scales, quats, scene.logit_opacities)
    dc, rest = scene.sh[:, 0].contiguous(), scene.sh[:, 1:].contiguous()
    return GSData.from_arrays(*(f.numpy() for f in (*fields, dc, rest)), format="ply")
