"""Tones that are no one map of colors: shadows, highlights, and sharpness of detail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.neighbors import nearest
from gsedit.words.instruction import MOST
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.scene import Gaussians

SHARE = 0.3
"""Share without a number."""
GAIN = 2.0
"""Largest factor less 1 of the deepest shadow, or the brightest light, for each share."""
NEAR = 16
"""Gaussians around one whose mean color its detail is told from."""
DETAIL = 3.0
"""Times that detail is added for each share: 30 % sharper nearly doubles it."""

Gains = Callable[[Float[Tensor, " n"], float], Float[Tensor, " n"]]


def _shadows(luma: Float[Tensor, " n"], share: float) -> Float[Tensor, " n"]:
    """Factors of colors by their luma: dark ones change, light ones stay."""
    return 1 + GAIN * share * (1 - luma) ** 3


def _highlights(luma: Float[Tensor, " n"], share: float) -> Float[Tensor, " n"]:
    """Factors of colors by their luma: light ones change, dark ones stay."""
    return 1 + GAIN / 2 * share * luma**3


CURVES: dict[str, Gains] = {"shadows": _shadows, "highlights": _highlights}
LOCAL = (*CURVES, "sharpness")
"""Names of the tones of this file."""


def locally_toned(
    scene: Gaussians, inside: Bool[Tensor, " n"], name: str, amount: float | None
) -> Gaussians:
    """Change shadows, highlights or sharpness of the Gaussians inside; others keep their bits.

    Raises UsageError for a share out of range.
    """
    share = SHARE if amount is None else amount
    if not -1 <= share <= MOST["tone"]:
        raise UsageError(f"{name} by {share:+.0%} is out of range: say a share from -100% to 500%")
    sh = scene.sh.clone()
    base = sh_to_color(sh[inside, 0])
    if name == "sharpness":
        _, beside = nearest(scene.means[inside].detach().cpu().numpy(), NEAR)
        detail = base - base[torch.from_numpy(beside)].mean(1) if beside.size else 0 * base
        factor = max(DETAIL * share, -1.0)
        sh[inside, 0] = color_to_sh((base + factor * detail).clamp(0.0, 1.0))
    else:
        luma = (base.clamp(0, 1) @ base.new_tensor(LUMINANCE)).clamp(0, 1)
        gain = CURVES[name](luma, share).clamp_min(0.0)
        sh[inside] *= gain[:, None, None]
        sh[inside, 0] = color_to_sh(base * gain[:, None])
    return replace(scene, sh=sh)
