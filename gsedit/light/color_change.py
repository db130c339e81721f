"""Changes of the colors of Gaussians that keep what depends on the direction. `n` Gaussians."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.scene.color_space import LUMINANCE
from rasterizer.numerics import SH_DC, sh_to_color
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class ColorChange:
    """Change of display colors, for each Gaussian: its saturation, a factor, and a veil over it."""

    saturation: float
    factor: Float[Tensor, "n 3"]
    veil: Float[Tensor, " n"]
    """Share, in [0, 1], that the veil's color replaces."""
    veil_color: Float[Tensor, "n 3"]

    def applied(self, scene: Gaussians) -> Gaussians:
        """The scene with its colors changed, from every direction alike."""
        sh = scene.sh.detach().double()
        color = sh_to_color(sh[:, :1])
        weights = torch.from_numpy(LUMINANCE / LUMINANCE.sum())

        def muted(values: Float[Tensor, "n k 3"]) -> Float[Tensor, "n k 3"]:
            gray = (values * weights).sum(-1, keepdim=True)
            return gray + self.saturation * (values - gray)

        clear = (1 - self.veil)[:, None, None]
        factor = self.factor[:, None] * clear
        color = muted(color) * factor + (self.veil[:, None] * self.veil_color)[:, None]
        rest = muted(sh[:, 1:]) * factor
        return replace(scene, sh=torch.cat(((color - 0.5) / SH_DC, rest), 1).to(scene.sh))


def only_inside(
    before: Gaussians, after: Gaussians, inside: Bool[Tensor, " n"] | None
) -> Gaussians:
    """The later scene inside, the earlier one's coefficients outside; None: inside is all.

    Bands that the earlier scene does not have are 0 outside.
    """
    if inside is None or bool(inside.all()):
        return after
    sh = torch.zeros_like(after.sh)
    sh[:, : before.sh.shape[1]] = before.sh.detach()
    return replace(after, sh=torch.where(inside[:, None, None], after.sh, sh))


def step(values: Float[Tensor, "*n"], low: float, high: float) -> Float[Tensor, "*n"]:
    """0 below `low`, 1 above `high`, smooth between; the other way round where `low` is larger."""
    t = ((values - low) / (high - low)).clamp(0, 1)
    return t * t * (3 - 2 * t)
