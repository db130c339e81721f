"""How much noise there is at each training step, and at which noise levels a sampler stops.

`t` is a training step, 0 the cleanest; `ab` the share of the signal in the power of x_t. A level is
x_t = a x0 + b noise, and sigma = b / a its noise in units of a clean latent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.settings import Spacing

RHO = 7.0  # Karras et al. 2022, section 3.1


class NoiseLevel(NamedTuple):
    """x_t = a x0 + b noise, with unit noise."""

    t: float
    """The training step, as a network's input; between two of them it is interpolated."""
    a: float
    b: float

    @property
    def sigma(self) -> float:
        """Infinite where nothing is left of the signal."""
        return self.b / self.a if self.a else math.inf


CLEAN = NoiseLevel(0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Schedule:
    """How much of the clean latents is left at each training step."""

    alphas_cumprod: Float[Tensor, " t"]
    """float64, falling from nearly 1 to nearly 0; the last may be exactly 0."""
    offset: int = 1
    """Added to every time step of the leading spacing (diffusers' `steps_offset`; 1 for SD)."""
    straight: bool = False
    """x_t = (1 - s) x0 + s noise, as rectified flows have it; otherwise a^2 + b^2 = 1."""

    @classmethod
    def scaled_linear(cls) -> Schedule:
        """Betas whose square roots are evenly spaced, as Stable Diffusion's."""
        roots = torch.linspace(0.00085**0.5, 0.012**0.5, 1000, dtype=torch.float64)
        return cls((1 - roots**2).cumprod(0))

    @classmethod
    def rectified_flow(cls, steps: int = 1000) -> Schedule:
        """Straight paths from the picture to the noise (Liu et al. 2023): s = t / steps."""
        s = torch.linspace(0, 1, steps + 1, dtype=torch.float64)
        return cls((1 - s) ** 2 / ((1 - s) ** 2 + s**2), straight=True)

    def level(self, t: int | float) -> NoiseLevel:
        """The level of a training step; between two, sigma is interpolated as diffusers does.

        Where sigma is infinite the signal's share is; on a straight schedule s is.
        """
        last = len(self.alphas_cumprod) - 1
        t = min(max(t, 0), last)
        low = min(int(t), last)
        ab, above = (float(self.alphas_cumprod[i]) for i in (low, min(low + 1, last)))
        part = t - low
        if self.straight:
            s, more = (_straight(share) for share in (ab, above))
            b = s + part * (more - s)
            return NoiseLevel(float(t), 1 - b, b)
        if part and above:
            sigma = _sigma(ab) + part * (_sigma(above) - _sigma(ab))
            ab = 1 / (1 + sigma**2)
        elif part:
            ab *= 1 - part
        return NoiseLevel(float(t), ab**0.5, (1 - ab) ** 0.5)

    def level_at(self, sigma: float) -> NoiseLevel:
        """The level of that sigma, with the training step where it is; CLEAN at 0.

        A sigma beyond the table has the table's end as its step.
        """
        if sigma == 0:
            return CLEAN
        ab = self.alphas_cumprod
        if self.straight:
            b = sigma / (1 + sigma)
            return NoiseLevel(_fractional_index(_straight(ab), b), 1 - b, b)
        a = (1 + sigma**2) ** -0.5
        index = _fractional_index(((1 - ab) / ab).sqrt(), sigma)
        return NoiseLevel(index, a, sigma * a)

    def alpha(self, t: int | float) -> float:
        """`ab` at `t`; before step 0 it is that of step 0, not 1 (set_alpha_to_one False)."""
        level = self.level(t)
        return level.a**2 / (level.a**2 + level.b**2)

    def t_max(self, strength: float) -> int:
        """The number of noise levels below `strength`."""
        return round(strength * len(self.alphas_cumprod))

    def timesteps(
        self, steps: int, strength: float = 1.0, spacing: Spacing = "leading"
    ) -> list[float]:
        """`steps` falling times below `strength` of the schedule.

        At strength 1 these are diffusers' times; below, the same spacing on a schedule cut short,
        so that a noised render is a valid start. Raises UsageError where fewer noise levels than
        steps are left, or the first has no finite sigma and the spacing needs one.
        """
        t_max = self.t_max(strength)
        if t_max < (steps if spacing in ("leading", "trailing") else min(steps, 2)):
            raise UsageError(
                f"strength {strength:g} leaves {t_max} noise levels for {steps} steps: "
                "raise the strength or ask for fewer steps"
            )
        match spacing:
            case "leading":
                stride = t_max // steps
                last = len(self.alphas_cumprod) - 1
                offset = min(self.offset, last - (steps - 1) * stride)  # 1000 of 1000 have no room
                return [float(i * stride + offset) for i in reversed(range(steps))]
            case "trailing":
                return [float(round(t_max - i * t_max / steps) - 1) for i in range(steps)]
            case "linspace":
                return even(t_max - 1, 0, steps)
            case "karras":
                return [level.t for level in self._karras(steps, t_max)]

    def levels(
        self, steps: int, strength: float = 1.0, spacing: Spacing = "leading", *, clean: bool = True
    ) -> list[NoiseLevel]:
        """`steps` + 1 falling levels: a step leads from one to the next.

        The last is CLEAN; without `clean` that of training step 0 (as Stable Diffusion's DDIM ends)
        unless the one before is that already. Raises what `timesteps` raises.
        """
        times = self.timesteps(steps, strength, spacing)
        if spacing == "karras":
            levels = self._karras(steps, self.t_max(strength))
        else:
            levels = [self.level(t) for t in times]
        return [*levels, CLEAN if clean or times[-1] <= 0 else self.level(0)]

    def _karras(self, steps: int, t_max: int) -> list[NoiseLevel]:
        first, last = self.level(t_max - 1), self.level(0)
        if math.isinf(first.sigma):
            raise UsageError(
                "karras spacing needs a finite first sigma and this schedule starts at a terminal "
                "SNR of 0: use trailing or linspace"
            )
        return [self.level_at(sigma) for sigma in karras_sigmas(first.sigma, last.sigma, steps)]


def karras_sigmas(first: float, last: float, count: int) -> list[float]:
    """Falling sigmas, their roots of the order RHO evenly spaced, both ends included."""
    return [root**RHO for root in even(first ** (1 / RHO), last ** (1 / RHO), count)]


def even(first: int | float, last: int | float, count: int) -> list[float]:
    """Numbers evenly spaced from the first to the last, both included."""
    return [first + (last - first) * i / max(count - 1, 1) for i in range(count)]


def _sigma(ab: float) -> float:
    return ((1 - ab) / ab) ** 0.5


def _straight(ab: Any) -> Any:
    """s of the straight level whose share of signal is ab, a number or a table."""
    return (1 - ab) ** 0.5 / (ab**0.5 + (1 - ab) ** 0.5)


def _fractional_index(rising: Float[Tensor, " t"], value: float) -> float:
    """The fractional index at which a rising table has that value, within the table."""
    above = int(torch.searchsorted(rising, value))
    if above == 0:
        return 0.0
    if above == len(rising):
        return float(above - 1)
    low, high = float(rising[above - 1]), float(rising[above])
    if math.isinf(high):  # there the share of the signal is interpolated, as in `level`
        return above - (1 + low**2) / (1 + value**2)
    return above - 1 + (value - low) / (high - low)
