"""How a batch of views is sampled: every choice in one record that checks itself. Loads no torch.

The docstring under each field of `SamplerSettings` is also the help text of its option; a field
whose metadata has a flag has it on the command line, the others are given by --set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

from gsedit.errors import UsageError

Target = Literal["x0", "xt", "eps"]
Noise = Literal["shared", "independent"]
Solver = Literal["ddim", "euler", "heun", "dpm++2m", "ancestral"]
Precision = Literal["float32", "bfloat16", "auto"]
Spacing = Literal["leading", "linspace", "trailing", "karras"]
"""Positions of the steps: three ways of dividing the training steps (named as in diffusers; leading
is Stable Diffusion's and starts below the top, linspace and trailing start at it), or sigmas whose
seventh roots are evenly spaced (Karras et al. 2022, eq. 5)."""


class SamplerDefaults(NamedTuple):
    """Defaults that a denoiser declares for settings that are None; the values here are
    InstructPix2Pix's."""

    guidance_text: float = 7.5
    guidance_image: float = 1.5
    t_end: float = 4.7
    """Sigma, where Stable Diffusion has done a fifth of its steps: the paper's 10 of 50."""
    steps: int = 20
    solver: Solver = "ddim"
    spacing: Spacing = "leading"


@dataclass(frozen=True)
class SamplerSettings:
    """How a batch of views is sampled. Every range is checked; a bad value is a UsageError."""

    steps: int | None = field(default=None, metadata={"flag": "--steps"})
    """Denoising steps, from 1 to 1000. The time of an edit is proportional to it. None: the
    editor's own (20; models distilled to few steps 4)."""
    guidance_text: float | None = None
    """Weight of the instruction, s_T of InstructPix2Pix, 0 or more; 1 or less adds no push towards
    it. None: the editor's own (7.5)."""
    guidance_image: float | None = None
    """Weight of the unedited picture, s_I of InstructPix2Pix, 0 or more; 1 skips the unconditional
    branch, a third of the cost. None: the editor's own (1.5)."""
    guidance_end: float = 0.0
    """The noise level, a sigma as t_end is, below which there is no guidance: of each step only the
    prediction under text and picture is computed, a third of the cost. 0: guidance to the end."""
    guidance_every: int = 1
    """How many steps share a computation of the guidance, 1 or more: the others add what it added
    last to the prediction under text and picture, a third of the cost."""
    strength: float = 0.98
    """Fraction of the noise schedule at which the noised render starts, above 0 and at most 1;
    less keeps more of the render, 1 none of it: sampling starts from noise, as in diffusers."""
    solver: Solver | None = None
    """How a step is taken. heun runs the network twice a step; ancestral draws fresh noise.
    None: the editor's own (ddim)."""
    spacing: Spacing | None = None
    """Positions of the steps on the noise schedule, named as in diffusers; karras spaces the
    seventh roots of sigma evenly. None: the editor's own (leading)."""
    eta: float = 0.0
    """Fresh noise of the solver ddim, from 0 (deterministic) to 1 (DDPM). The clusters of
    corresponding cells share it as they share the first noise; ancestral always has 1."""
    t_end: float | None = None
    """The noise level at which consensus ends: it acts while sigma, the noise's deviation in units
    of a clean latent, is above t_end; 0 or more, at 0 to the end. None: the editor's own (4.7)."""
    target: Target = "x0"
    """Quantity that corresponding cells agree on: the predicted clean latent x0 (and eps follows
    from it), the next latent x_{t-1} (xt), or the predicted noise eps."""
    noise: Noise = "shared"
    """Whether corresponding cells start from the same noise."""
    consensus: bool = True
    """Whether corresponding cells of the views are made to agree while they are sampled."""
    harmonise: bool = True
    """Whether, with consensus, the finished views' coarse colors are brought to agreement where
    the depth of the scene says that they show the same place."""
    precision: Precision = "auto"
    """Arithmetic of the network. auto takes bfloat16 where the processor has it and its error,
    measured on the first pass, is at most 2 %."""

    def __post_init__(self) -> None:
        self._check_ranges()
        self._check_choices()
        self._check_combinations()

    def _check_ranges(self) -> None:
        valid = self.steps is None or 1 <= self.steps <= 1000
        _require(valid, "steps", self.steps, "from 1 to 1000")
        valid = self.guidance_every >= 1
        _require(valid, "guidance_every", self.guidance_every, "1 or more")
        for name in ("guidance_text", "guidance_image", "guidance_end", "t_end"):
            value = getattr(self, name)
            valid = value is None or (math.isfinite(value) and value >= 0)
            _require(valid, name, value, "finite and not negative")
        _require(0 < self.strength <= 1, "strength", self.strength, "above 0 and at most 1")
        _require(0 <= self.eta <= 1, "eta", self.eta, "from 0 to 1")

    def _check_choices(self) -> None:
        choices = {
            "target": Target,
            "noise": Noise,
            "solver": Solver,
            "spacing": Spacing,
            "precision": Precision,
        }
        for name, allowed in choices.items():
            value, names = getattr(self, name), get_args(allowed)
            valid = value is None or value in names
            _require(valid, name, value, f"one of {', '.join(names)}")

    def _check_combinations(self) -> None:
        if self.step_spacing in ("leading", "trailing"):
            most = int(1000 * self.strength)  # noise levels of Stable Diffusion's schedule
            _require(
                self.step_count <= most,
                "steps",
                self.step_count,
                f"at most {most} at this strength",
            )
        if self.eta and self.method not in ("ddim", "ancestral"):
            raise UsageError(
                f"eta {self.eta:g} is for the solver ddim, {self.method} has none: "
                "use solver ddim, or eta 0"
            )
        if self.consensus and self.target == "eps" and self.noise == "independent":
            raise UsageError(
                "target eps needs noise shared: the mean of independent predictions is not noise "
                "of unit variance, and sampling diverges; use noise shared or target x0"
            )

    def with_defaults(self, defaults: SamplerDefaults) -> SamplerSettings:
        """These settings, with the defaults where they are None."""
        missing = {
            name: value for name, value in defaults._asdict().items() if getattr(self, name) is None
        }
        return replace(self, **missing)

    def _told(self, name: str) -> Any:
        """A setting, or InstructPix2Pix's where it is None."""
        value = getattr(self, name)
        return getattr(SamplerDefaults(), name) if value is None else value

    @property
    def scales(self) -> tuple[float, float]:
        """(s_T, s_I), with InstructPix2Pix's where they are None."""
        return self._told("guidance_text"), self._told("guidance_image")

    @property
    def step_spacing(self) -> Spacing:
        """The spacing, with InstructPix2Pix's where it is None."""
        return self._told("spacing")

    @property
    def consensus_end(self) -> float:
        """Sigma of t_end, with InstructPix2Pix's where it is None."""
        return self._told("t_end")

    @property
    def fresh_noise(self) -> float:
        """The share of the noise that each step draws anew: eta, or 1 for ancestral."""
        return 1.0 if self.method == "ancestral" else self.eta

    @property
    def step_count(self) -> int:
        """The steps, with InstructPix2Pix's where they are None."""
        return self._told("steps")

    @property
    def method(self) -> Solver:
        """The solver, with InstructPix2Pix's where it is None."""
        return self._told("solver")


def _require(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise UsageError(f"{name} must be {allowed}, not {value!r}")
