"""Diffusion sampling: schedule, guidance, and DDIM as a generator with a consensus hook.

`v` views, `c` channels, `y x` latent cells. `t` is a training step, `ab` the schedule's cumulative
product there: x_t = sqrt(ab) x0 + sqrt(1 - ab) eps. `x0` and `eps` are predictions unless said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, get_args, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError

Hook = Callable[[Tensor], Tensor]
"""A map of [v c y x] to itself: what makes corresponding cells agree."""

Answer = Callable[[Tensor], Tensor]
"""A map from unedited to truly edited pictures [n h w 3]."""

Target = Literal["x0", "xt", "eps"]
Noise = Literal["shared", "independent"]


@dataclass(frozen=True, eq=False)
class Schedule:
    """How much of the picture is left at each training step."""

    alphas_cumprod: Float[Tensor, " t"]
    """float64, falling from nearly 1 to nearly 0."""
    offset: int = 1
    """Added to every time step of the leading spacing (diffusers' `steps_offset`; 1 for SD)."""

    @classmethod
    def scaled_linear(
        cls, beta_start: float = 0.00085, beta_end: float = 0.012, steps: int = 1000
    ) -> Schedule:
        """Betas whose square roots are evenly spaced. The defaults are Stable Diffusion's."""
        roots = torch.linspace(beta_start**0.5, beta_end**0.5, steps, dtype=torch.float64)
        return cls((1 - roots**2).cumprod(0))

    def timesteps(self, steps: int, strength: float = 1.0) -> list[int]:
        """`steps` falling times, evenly strided below `strength` of the schedule.

        At strength 1 these are diffusers' DDIM times (leading spacing); below, the same spacing on
        a schedule cut short, so that a noised render is a valid start. Raises UsageError where
        fewer noise levels than steps are left.
        """
        t_max = self.t_max(strength)
        if steps > t_max:
            raise UsageError(
                f"strength {strength:g} leaves {t_max} noise levels for {steps} steps: "
                "raise the strength or ask for fewer steps"
            )
        stride = t_max // steps
        last = len(self.alphas_cumprod) - 1
        return [min(i * stride + self.offset, last) for i in reversed(range(steps))]

    def t_max(self, strength: float) -> int:
        """The number of noise levels below `strength`."""
        return round(strength * len(self.alphas_cumprod))

    def alpha(self, t: int) -> float:
        """`ab` at `t`; before step 0 it is that of step 0, not 1 (set_alpha_to_one False)."""
        return float(self.alphas_cumprod[max(t, 0)])


@dataclass(frozen=True)
class SamplerSettings:
    """How a batch of views is sampled. Every range is checked; a bad value is a UsageError."""

    steps: int = 20
    guidance_text: float = 7.5
    """s_T: 1 or less means no push towards the instruction."""
    guidance_image: float = 1.5
    """s_I: 1 skips the unconditional branch, a third of the cost, exactly."""
    strength: float = 0.98
    """Fraction of the schedule at which the noised render starts, in (0, 1]."""
    eta: float = 0.0
    """0 is deterministic DDIM, 1 is DDPM; fresh noise is shared by the clusters as the first is."""
    t_end: float = 0.8
    """Consensus acts while t > t_end * t_max: a noise level, so it does not depend on `steps`."""
    target: Target = "x0"
    """What corresponding cells agree on: x0 (each view keeps its own eps), x_{t-1}, or eps."""
    noise: Noise = "shared"
    """Whether corresponding cells start from the same noise."""
    consensus: bool = True
    consensus_strength: float = 1.0
    """0 leaves every view alone, 1 makes corresponding cells equal."""

    def __post_init__(self) -> None:
        _require(1 <= self.steps <= 1000, "steps", self.steps, "from 1 to 1000")
        for name in ("guidance_text", "guidance_image"):
            value = getattr(self, name)
            _require(math.isfinite(value) and value >= 0, name, value, "finite and not negative")
        _require(0 < self.strength <= 1, "strength", self.strength, "above 0 and at most 1")
        most = int(1000 * self.strength)  # noise levels of Stable Diffusion's schedule
        _require(self.steps <= most, "steps", self.steps, f"at most {most} at this strength")
        for name in ("eta", "t_end", "consensus_strength"):
            value = getattr(self, name)
            _require(0 <= value <= 1, name, value, "from 0 to 1")
        _require(self.target in get_args(Target), "target", self.target, "x0, xt or eps")
        _require(self.noise in get_args(Noise), "noise", self.noise, "shared or independent")
        if self.consensus and self.target == "eps" and self.noise == "independent":
            raise UsageError(
                "target eps needs noise shared: the mean of independent predictions is not noise "
                "of unit variance, and sampling diverges; use --noise shared or --target x0"
            )

    @classmethod
    def preset(cls, name: str) -> SamplerSettings:
        """`default`, or `paper`: eq. (averageall) as printed, on x_{t-1} of independent noise."""
        match name:
            case "default":
                return cls()
            case "paper":
                return cls(steps=50, strength=1.0, target="xt", noise="independent")
        raise UsageError(f"preset must be default or paper, not {name!r}")


def _require(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise UsageError(f"{name} must be {allowed}, not {value!r}")


class Branches(NamedTuple):
    """The eps predictions of the three conditions, each [v c y x]."""

    text_image: Tensor
    image: Tensor
    none: Tensor | None
    """None where it was not asked for."""


@runtime_checkable
class Denoiser(Protocol):
    """A diffusion model of edited images, in its own latent space. Stateless."""

    @property
    def name(self) -> str: ...

    @property
    def cell(self) -> int:
        """Pixels per latent cell; image sides are multiples of it."""
        ...

    @property
    def channels(self) -> int: ...

    @property
    def schedule(self) -> Schedule: ...

    def check(self, prompt: str) -> None:
        """Raise UsageError, with the next move, for an instruction it cannot follow."""
        ...

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """Latents, scaled as the sampler wants them, of images in [0, 1]."""
        ...

    def encode_edited(
        self,
        images: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
    ) -> Float[Tensor, "v c y x"]:
        """Latents of finished edits of these originals: what anchored views are held to."""
        ...

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """Images, not clamped: the inverse of encode as far as there is one."""
        ...

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Any:
        """Whatever `branches` needs and no step changes; computed once for the views."""
        ...

    def branches(
        self, x: Float[Tensor, "v c y x"], t: int, condition: Any, need_none: bool
    ) -> Branches:
        """eps for each condition, in the dtype of `x`."""
        ...

    def answer(
        self,
        prompt: str,
        edited: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
    ) -> Answer | None:
        """The true edit that most of these views show; None for a model that knows of none."""
        ...


def guide(text_image: Tensor, image: Tensor, none: Tensor | None, s_T: float, s_I: float) -> Tensor:
    """Classifier-free guidance of InstructPix2Pix (eq. 3 there); the three weights sum to 1.

    Without the unconditional branch the result is the formula's at s_I = 1.
    """
    guided = image + s_T * (text_image - image)
    if none is None:
        return guided
    return guided + (s_I - 1) * (image - none)


@dataclass(frozen=True, eq=False)
class State:
    """The latents after one step of the sampler."""

    step: int
    """1 to `steps`."""
    steps: int
    t: int
    """The noise level that `x` has reached; 0 at the end."""
    x: Float[Tensor, "v c y x"]
    """x_t."""
    x0: Float[Tensor, "v c y x"]
    """The clean latents that this step moved towards."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """Views whose answer is known: their x0 is given, and the denoiser is not asked."""

    views: Bool[Tensor, " v"]
    x0: Float[Tensor, "v c y x"]
    """Only the rows of `views` are read."""


def add_noise(
    x0: Float[Tensor, "v c y x"], noise: Float[Tensor, "v c y x"], ab: float
) -> Float[Tensor, "v c y x"]:
    return ab**0.5 * x0 + (1 - ab) ** 0.5 * noise


def sample(
    denoiser: Denoiser,
    condition: Any,
    x: Float[Tensor, "v c y x"],
    settings: SamplerSettings,
    *,
    consensus: Hook | None = None,
    share: Hook | None = None,
    anchor: Anchor | None = None,
    generator: torch.Generator | None = None,
) -> Iterator[State]:
    """DDIM from `x`, latents noised to the first of the schedule's time steps; yields every step.

    `consensus` acts on `settings.target` while t > t_end * t_max; `share` acts on fresh noise,
    which only eta > 0 draws (from `generator`, then required: UsageError). `condition` is that of
    the views that are not anchored, in their order. No state is kept between steps.
    """
    if settings.eta > 0 and generator is None:
        raise UsageError("eta above 0 draws fresh noise and needs a generator")
    times = denoiser.schedule.timesteps(settings.steps, settings.strength)
    stride = denoiser.schedule.t_max(settings.strength) // settings.steps
    t_stop = settings.t_end * denoiser.schedule.t_max(settings.strength)
    for step, t in enumerate(times, start=1):
        ab, ab_next = denoiser.schedule.alpha(t), denoiser.schedule.alpha(t - stride)
        agree = consensus if settings.consensus and consensus and t > t_stop else _identity
        eps = _predict(denoiser, condition, x, t, settings, anchor)
        if settings.target == "eps":
            eps = agree(eps)
        x0 = (x - (1 - ab) ** 0.5 * eps) / ab**0.5
        if settings.target == "x0":
            x0 = agree(x0)  # each view keeps its own eps: SyncTweedies' best case
        x = _ddim(x0, eps, ab, ab_next, settings.eta, generator, share or _identity)
        if settings.target == "xt":
            x = agree(x)
        yield State(step, settings.steps, max(t - stride, 0), x, x0)


def _identity(x: Tensor) -> Tensor:
    return x


def _predict(
    denoiser: Denoiser,
    condition: Any,
    x: Tensor,
    t: int,
    settings: SamplerSettings,
    anchor: Anchor | None,
) -> Tensor:
    """Guided eps; of an anchored view, the eps that leads to its known x0."""
    s_T, s_I = settings.guidance_text, settings.guidance_image
    if anchor is None:
        return guide(*denoiser.branches(x, t, condition, s_I != 1), s_T, s_I)
    ab = denoiser.schedule.alpha(t)
    eps = (x - ab**0.5 * anchor.x0) / (1 - ab) ** 0.5
    free = ~anchor.views
    if free.any():
        eps[free] = guide(*denoiser.branches(x[free], t, condition, s_I != 1), s_T, s_I)
    return eps


def _ddim(
    x0: Tensor,
    eps: Tensor,
    ab: float,
    ab_next: float,
    eta: float,
    generator: torch.Generator | None,
    share: Hook,
) -> Tensor:
    """Eq. 12 of DDIM (Song et al. 2021); the variance is its eq. 16."""
    if eta == 0:
        return add_noise(x0, eps, ab_next)
    variance = eta**2 * (1 - ab_next) / (1 - ab) * (1 - ab / ab_next)
    noise = share(torch.randn(x0.shape, generator=generator, dtype=x0.dtype))
    return ab_next**0.5 * x0 + (1 - ab_next - variance) ** 0.5 * eps + variance**0.5 * noise
