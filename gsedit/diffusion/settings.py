"""How a batch of views is sampled: every choice in one record that checks itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

from gsedit.diffusion.schedules import Spacing
from gsedit.errors import UsageError

Target = Literal["x0", "xt", "eps"]
Noise = Literal["shared", "independent"]
Solver = Literal["ddim", "euler", "heun", "dpm++2m", "ancestral"]
Precision = Literal["float32", "bfloat16", "auto"]


class Suits(NamedTuple):
    """What suits a denoiser where the settings say nothing; as it stands, InstructPix2Pix."""

    guidance_text: float = 7.5
    guidance_image: float = 1.5
    temperature: float = 1.0


def suits(denoiser: object) -> Suits:
    """What a denoiser, or an editor, says of itself: few do."""
    return getattr(denoiser, "suits", Suits())


@dataclass(frozen=True)
class SamplerSettings:
    """How a batch of views is sampled. Every range is checked; a bad value is a UsageError."""

    steps: int = 20
    guidance_text: float | None = None
    """s_T: 1 or less means no push towards the instruction. None: what suits the denoiser."""
    guidance_image: float | None = None
    """s_I: 1 skips the unconditional branch, a third of the cost, exactly. None: as above."""
    strength: float = 0.98
    """Fraction of the schedule at which the noised render starts, in (0, 1]."""
    solver: Solver = "ddim"
    """How a step is taken (see gsedit.diffusion.solvers); heun asks the network twice a step."""
    spacing: Spacing = "leading"
    """Where the steps lie (see gsedit.diffusion.schedules)."""
    eta: float = 0.0
    """Of ddim: 0 is deterministic, 1 is DDPM; fresh noise is shared by the clusters as the first
    is. `ancestral` is always 1."""
    t_end: float = 0.8
    """Consensus acts while t > t_end * t_max: a noise level, so it does not depend on `steps`."""
    target: Target = "x0"
    """What corresponding cells agree on: x0 (each view keeps its own eps), x_{t-1}, or eps."""
    noise: Noise = "shared"
    """Whether corresponding cells start from the same noise."""
    consensus: bool = True
    consensus_strength: float = 1.0
    """0 leaves every view alone, 1 makes corresponding cells equal."""
    memory: float | None = None
    """GB that the networks' passes may use at once; None: half of what is free."""
    precision: Precision = "auto"
    """Of a network's arithmetic; auto: bfloat16 where the processor has it and the error, measured
    on the first pass, is below the bound of gsedit.diffusion.machine."""
    temperature: float | None = None
    """Factor of the starting noise: 1 draws from what the denoiser finds possible, less stays near
    the middle of it. None: what suits the denoiser."""

    def __post_init__(self) -> None:
        _require(1 <= self.steps <= 1000, "steps", self.steps, "from 1 to 1000")
        for name in ("guidance_text", "guidance_image"):
            value = getattr(self, name)
            known = value is None or (math.isfinite(value) and value >= 0)
            _require(known, name, value, "finite and not negative")
        known = self.temperature is None or 0 <= self.temperature <= 1
        _require(known, "temperature", self.temperature, "from 0 to 1")
        _require(0 < self.strength <= 1, "strength", self.strength, "above 0 and at most 1")
        choices = {"target": Target, "noise": Noise, "solver": Solver, "spacing": Spacing}
        for name, allowed in (choices | {"precision": Precision}).items():
            value, told = getattr(self, name), ", ".join(get_args(allowed))
            _require(value in get_args(allowed), name, value, f"one of {told}")
        if self.spacing in ("leading", "trailing"):
            most = int(1000 * self.strength)  # noise levels of Stable Diffusion's schedule
            _require(self.steps <= most, "steps", self.steps, f"at most {most} at this strength")
        for name in ("eta", "t_end", "consensus_strength"):
            value = getattr(self, name)
            _require(0 <= value <= 1, name, value, "from 0 to 1")
        if self.memory is not None:
            known = math.isfinite(self.memory) and self.memory > 0
            _require(known, "memory", self.memory, "a number of GB above 0")
        if self.eta and self.solver not in ("ddim", "ancestral"):
            raise UsageError(
                f"eta {self.eta:g} is for the solver ddim, {self.solver} draws no noise: "
                "use solver ddim, or eta 0"
            )
        if self.consensus and self.target == "eps" and self.noise == "independent":
            raise UsageError(
                "target eps needs noise shared: the mean of independent predictions is not noise "
                "of unit variance, and sampling diverges; use --noise shared or --target x0"
            )

    @property
    def scales(self) -> tuple[float, float]:
        """(s_T, s_I) in force; InstructPix2Pix's where nothing was said."""
        return self.in_force(Suits())[:2]

    def in_force(self, to: Suits) -> Suits:
        """What was said, and what suits a denoiser where nothing was."""
        said = ((getattr(self, name), value) for name, value in to._asdict().items())
        return Suits(*(suited if asked is None else asked for asked, suited in said))

    def suited(self, to: Suits) -> SamplerSettings:
        """With what suits a denoiser where nothing was said."""
        return replace(self, **self.in_force(to)._asdict())

    @property
    def fresh_noise(self) -> float:
        """The eta in force: the share of the noise that each step draws anew."""
        return 1.0 if self.solver == "ancestral" else self.eta

    @classmethod
    def preset(cls, name: str) -> SamplerSettings:
        """`default`, or `paper`: eq. (averageall) as printed, on x_{t-1} of independent noise."""
        match name:
            case "default":
                return cls()
            case "paper":
                return cls(
                    steps=50, strength=1.0, target="xt", noise="independent", temperature=1.0
                )
        raise UsageError(f"preset must be default or paper, not {name!r}")


def _require(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise UsageError(f"{name} must be {allowed}, not {value!r}")
