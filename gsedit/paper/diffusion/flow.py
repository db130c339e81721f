"""The noise levels of flow-matching models, from diffusers' FlowMatchEulerDiscreteScheduler files.

s is the share of noise of a straight level, x = (1 - s) x0 + s noise. A falling line of s is drawn
first, then bent towards the noise: more so the larger the picture (Esser et al. 2024, section 5.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.schedules import CLEAN, NoiseLevel, Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings

CLASS = "FlowMatchEulerDiscreteScheduler"
OTHER_LINES = (
    "use_karras_sigmas",
    "use_exponential_sigmas",
    "use_beta_sigmas",
    "invert_sigmas",
    "stochastic_sampling",
)
"""Options of diffusers' scheduler that no supported model sets."""


@dataclass(frozen=True)
class FlowScheduler:
    """The settings of a FlowMatchEulerDiscreteScheduler; the defaults are diffusers' own."""

    train_steps: int = 1000
    """A network reads s times this."""
    shift: float = 1.0
    """Factor on the ratio of noise to signal, s / (1 - s); not used where `dynamic`."""
    dynamic: bool = False
    """Whether that factor depends on the size of the picture: exp(mu), or mu itself."""
    exponential: bool = True
    """The factor is exp(mu), not mu."""
    base_shift: float = 0.5
    max_shift: float = 1.15
    base_length: int = 256
    max_length: int = 4096
    """Numbers of tokens at which mu is `base_shift` and `max_shift`."""
    terminal: float | None = None
    """The last s before the clean picture, to which the bent line is stretched."""

    @classmethod
    def read(cls, config: Mapping[str, Any], place: str | Path) -> FlowScheduler:
        """Settings of a scheduler_config.json; `place` is named in errors.

        Raises InputError, which names what is not supported, rather than take another schedule.
        """
        name = config.get("_class_name", CLASS)
        if name != CLASS:
            raise InputError(f"{place}: the scheduler is {name}, this model needs {CLASS}")
        for option in OTHER_LINES:
            if config.get(option):
                raise InputError(f"{place}: {option} is not supported, it must be false")
        kind = config.get("time_shift_type", "exponential")
        if kind not in ("exponential", "linear"):
            raise InputError(f"{place}: time_shift_type {kind!r} is not exponential or linear")
        number = _numbers(config, place)
        terminal = number("shift_terminal", 0.0)
        if not 0 <= terminal < 1:
            raise InputError(f"{place}: shift_terminal is {terminal:g}, not from 0 to below 1")
        return cls(
            train_steps=int(number("num_train_timesteps", cls.train_steps, above=0.0)),
            shift=number("shift", cls.shift, above=0.0),
            dynamic=bool(config.get("use_dynamic_shifting", cls.dynamic)),
            exponential=kind == "exponential",
            base_shift=number("base_shift", cls.base_shift),
            max_shift=number("max_shift", cls.max_shift),
            base_length=int(number("base_image_seq_len", cls.base_length, above=0.0)),
            max_length=int(number("max_image_seq_len", cls.max_length, above=0.0)),
            terminal=terminal or None,
        )

    @property
    def schedule(self) -> Schedule:
        """Straight paths with as many training steps."""
        return Schedule.rectified_flow(self.train_steps)

    def mu(self, tokens: int) -> float:
        """The shift of a picture of so many tokens: a straight line through the two given."""
        slope = (self.max_shift - self.base_shift) / (self.max_length - self.base_length)
        return self.base_shift + slope * (tokens - self.base_length)

    def levels_of(self, settings: SamplerSettings, tokens: int) -> list[NoiseLevel]:
        """The levels of these settings for a picture of so many tokens. Raises UsageError."""
        check_spacing(settings)
        mu = self.mu(tokens)
        return self.levels(settings.step_count, settings.strength, mu=mu)

    def levels(self, steps: int, strength: float = 1.0, *, mu: float = 0.0) -> list[NoiseLevel]:
        """`steps` + 1 falling levels, the last CLEAN.

        The line falls from `strength` to its part `1 / steps`, as the pipelines ask. `mu` is not
        read unless `dynamic`.
        """
        bent = [self._bent(strength * (1 - i / steps), mu) for i in range(steps)]
        return [*(self._level(s) for s in self._stretched(bent)), CLEAN]

    def _bent(self, s: float, mu: float) -> float:
        if not self.dynamic:
            return _shifted(s, self.shift)
        return _shifted(s, math.exp(mu) if self.exponential else mu)

    def _stretched(self, line: list[float]) -> list[float]:
        """The line with `terminal` as its last s, as far as it is not one level of pure noise."""
        if self.terminal is None or line[-1] >= 1:
            return line
        scale = (1 - self.terminal) / (1 - line[-1])
        return [1 - (1 - s) * scale for s in line]

    def _level(self, s: float) -> NoiseLevel:
        return NoiseLevel(self.train_steps * s, 1 - s, s)


def empirical_mu(tokens: int, steps: int) -> float:
    """The shift of FLUX.2: two lines in the number of tokens, of 10 and of 200 steps.

    Between them it is linear in the number of steps; above 4300 tokens it is that of 200 steps.
    """
    of_200 = 0.00016927 * tokens + 0.45666666
    if tokens > 4300:
        return of_200
    of_10 = 8.73809524e-05 * tokens + 1.89833333
    return of_200 + (of_200 - of_10) * (steps - 200) / 190


def check_spacing(settings: SamplerSettings) -> None:
    """Raise UsageError for a spacing other than the default: a flow model has its own."""
    if settings.step_spacing != SamplerDefaults().spacing:
        raise UsageError(
            f"spacing {settings.step_spacing} is not for this model, which divides its noise "
            "levels in its own way: leave it out"
        )


def _shifted(s: float, factor: float) -> float:
    return factor * s / (1 + (factor - 1) * s)


def _numbers(config: Mapping[str, Any], place: str | Path) -> Callable[..., float]:
    """A reader of numbers that names the file and the key of one that is none."""

    def number(key: str, default: float | int, *, above: float = -math.inf) -> float:
        value = config.get(key)
        value = default if value is None else value
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > above:
            limit = "" if above == -math.inf else f" above {above:g}"
            raise InputError(f"{place}: {key} is {value!r}, not a number{limit}")
        return float(value)

    return number
