"""An editor whose answers vary at random, with a known mean: the exact edit.

`v` views of `h w` pixels. The distribution of a view's edit is a Gaussian field about the exact
edit: offsets of brightness and tint, blotches and texture, stronger the coarser they are, as in
natural pictures. So is its denoiser exact, and linear: E[x0 | q] filters q - mean by P / (P + s^2),
in every frequency, P the field's power and s the noise. Coarse structure is decided early, texture
late: as the paper says of diffusion models, and as no analytic choice among variants has it.
Each view's exact edit is also bent by a smooth warp of its own, which no noise that views share
undoes. Guidance is 1: one evaluation a step.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import sqrt
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.measures.features import OPPONENT
from gsedit.paper.diffusion.guidance import Branches, Need
from gsedit.paper.diffusion.predictions import Prediction
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults
from gsedit.paper.editors.looks.recipe import parse
from gsedit.paper.protocol import Capabilities
from gsedit.views.padding import PadMode

CELL = 8  # pixels, as Stable Diffusion's


def long_schedule() -> Schedule:
    """Stable Diffusion's, on to a noise of 320: there 5 % of the start remain, 75 % at its 13."""
    return Schedule.scaled_linear(beta_end=0.03)


@dataclass(frozen=True, eq=False)
class Varied:
    """A Denoiser in which a latent cell is its pixels, with values in [-1, 1]."""

    offset: float = 0.06
    """Standard deviation of the mean brightness, of values in [-1, 1]; fields of k cycles a picture
    have k^-3 of its power, so that a pixel varies by 2.7 times as much."""
    tint: float = 0.5
    """Amplitude of the two opponent colors over that of brightness."""
    bend: float = 0.7
    """Standard deviation of the warp, pixels, at 4x4 places of a picture."""
    schedule: Schedule = field(default_factory=long_schedule)
    name: str = "varied"
    cell: int = CELL
    multiple: int = CELL
    padding: PadMode = "edge"
    channels: int = 3 * CELL * CELL
    predicts: Prediction = "eps"

    @property
    def capabilities(self) -> Capabilities:
        """Without guidance; the true edit is the first variant of the instruction's recipe."""
        return Capabilities(
            defaults=SamplerDefaults(guidance_text=1.0, guidance_image=1.0),
            find_ground_truth=lambda prompt, *views: partial(parse(prompt).variant, k=0),
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError if the instruction names no look."""
        parse(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """A cell's 8x8 pixels as channels."""
        return F.pixel_unshuffle((2 * images - 1).movedim(-1, 1), CELL)

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        """Latents of the pictures, as of any others."""
        return self.encode(images)

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The exact inverse of encode."""
        return F.pixel_shuffle(latents, CELL).movedim(1, -1) / 2 + 0.5

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Float[Tensor, "v c y x"]:
        """The mean of each view's edits, in latents. Raises UsageError."""
        exact = parse(prompt).variant(originals, 0)
        return self.encode(warped(exact, self.bend, generator))

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The exact eps; every branch that is asked for is the same."""
        ab = self.schedule.alpha(t)
        variance, q = (1 - ab) / ab, x / ab**0.5
        away = F.pixel_shuffle(q - condition, CELL)
        power = self.power(away.shape[-2], away.shape[-1])
        basis = torch.tensor(OPPONENT)
        spectrum = torch.fft.rfft2(torch.einsum("oc,vchw->vohw", basis, away))
        kept = torch.fft.irfft2(spectrum * (power / (power + variance)), s=away.shape[-2:])
        x0 = condition + F.pixel_unshuffle(torch.einsum("oc,vohw->vchw", basis, kept), CELL)
        eps = (q - x0) / variance**0.5
        return Branches(*(eps if wanted else None for wanted in need))

    def power(self, height: int, width: int) -> Float[Tensor, "3 h f"]:
        """The field's power in opponent colors at each frequency of an orthonormal transform."""
        side = sqrt(height * width)
        f = torch.hypot(torch.fft.fftfreq(height)[:, None], torch.fft.rfftfreq(width))
        power = (self.offset * side) ** 2 / (f * side).clamp_min(1) ** 3
        return torch.stack((power, self.tint**2 * power, self.tint**2 * power))


def warped(
    images: Float[Tensor, "v h w 3"], bend: float, generator: torch.Generator
) -> Float[Tensor, "v h w 3"]:
    """Each picture moved by a smooth field of displacements of this standard deviation, pixels."""
    views, height, width = images.shape[:3]
    coarse = bend * torch.randn(views, 2, 4, 4, generator=generator)
    moved = F.interpolate(coarse, (height, width), mode="bicubic", align_corners=True)
    grid = F.affine_grid(torch.eye(2, 3).expand(views, 2, 3), [views, 3, height, width], False)
    grid = grid + 2 * moved.movedim(1, -1) / torch.tensor((width, height))
    pictures = images.movedim(-1, 1)
    found = F.grid_sample(pictures, grid, "bicubic", "border", align_corners=False)
    return found.movedim(1, -1).clamp(0, 1)
