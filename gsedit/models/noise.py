"""The noise schedule of a Stable Diffusion model, as its scheduler's class and settings say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch

from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import (
    CLEAN,
    RHO,
    NoiseLevel,
    Schedule,
    even,
    karras_sigmas,
)
from gsedit.diffusion.settings import SamplerDefaults, SamplerSettings, Spacing
from gsedit.errors import InputError, UsageError
from gsedit.storage.json_files import checked, number, object_of

PREDICTIONS: dict[str, Prediction] = {"epsilon": "eps", "v_prediction": "v"}
"""By their names in diffusers' configs."""
CONSISTENCY = SamplerDefaults(steps=4, solver="lcm", t_end=1.2)
"""Latent consistency models are distilled for few steps (Luo et al. 2023). t_end: three steps of
four. A guess, since it was measured with an exact score alone (docs/measurements/sampler.md)."""

NUMBERS = object_of(
    {},
    {
        "beta_start": number(1e-9, 0.999),
        "beta_end": number(1e-9, 0.999),
        "num_train_timesteps": number(2.0, 1e5),
        "steps_offset": number(0.0, 1e3),
        "original_inference_steps": number(1.0, 1e3),
        "sigma_min": number(1e-9, 1e9),
        "sigma_max": number(1e-9, 1e9),
        "rho": number(1e-3, 1e3),
    },
)
"""Ranges of a scheduler's numbers; outside of them there is no schedule."""

Levels = Callable[[SamplerSettings, tuple[int, int]], list[NoiseLevel]]


class Noise(NamedTuple):
    """How much noise there is, what is predicted of it, and where sampling stops between."""

    schedule: Schedule
    predicts: Prediction
    levels: Levels | None = None
    """See `Capabilities.levels`. None: those that the settings divide the schedule into."""
    defaults: SamplerDefaults = SamplerDefaults()


def noise_of(config: Mapping[str, Any], place: Path) -> Noise:
    """The noise of a scheduler's settings, `_class_name` among them; Stable Diffusion's without.

    Raises InputError, which begins with the place, for a schedule that is not supported.
    """
    checked({key: value for key, value in config.items() if value is not None}, NUMBERS, place)
    name = config.get("_class_name", "")
    if name == "EDMEulerScheduler":
        return _edm(config, place)
    noise = Noise(_from_betas(config, place), _prediction(config, place, tuple(PREDICTIONS)))
    if name == "LCMScheduler":
        original = config.get("original_inference_steps", 50)
        levels = partial(_consistency_levels, noise.schedule, original)
        return noise._replace(levels=levels, defaults=CONSISTENCY)
    if config.get("use_karras_sigmas"):
        return noise._replace(defaults=SamplerDefaults(spacing="karras"))
    if config.get("timestep_spacing") == "trailing":
        return noise._replace(defaults=SamplerDefaults(spacing="trailing"))
    if config.get("set_alpha_to_one"):
        return noise._replace(levels=partial(_levels_to_clean, noise.schedule))
    return noise


def _prediction(config: Mapping[str, Any], place: Path, names: tuple[str, ...]) -> Prediction:
    name = config.get("prediction_type", "epsilon")
    if name not in names:
        raise InputError(f"{place}: prediction_type {name!r} is not {' or '.join(names)}")
    return PREDICTIONS[name]


def _from_betas(config: Mapping[str, Any], place: Path) -> Schedule:
    """Stable Diffusion's schedule, or another of a formula for its betas."""
    start, end = config.get("beta_start", 0.00085), config.get("beta_end", 0.012)
    steps, kind = config.get("num_train_timesteps", 1000), config.get("beta_schedule")
    if config.get("trained_betas") is not None:
        raise InputError(f"{place}: trained betas are not supported, only a formula")
    if config.get("use_flow_sigmas"):
        raise InputError(f"{place}: use_flow_sigmas makes it flow matching, which no U-Net here is")
    if kind in (None, "scaled_linear"):
        schedule = Schedule.scaled_linear(start, end, steps)
    elif kind == "linear":
        betas = torch.linspace(start, end, steps, dtype=torch.float64)
        schedule = Schedule((1 - betas).cumprod(0))
    else:
        raise InputError(f"{place}: beta_schedule {kind!r} is not scaled_linear or linear")
    if config.get("rescale_betas_zero_snr"):
        schedule = schedule.zero_terminal_snr()
    return replace(schedule, offset=config.get("steps_offset", 1))


def _levels_to_clean(
    schedule: Schedule, settings: SamplerSettings, _: tuple[int, int]
) -> list[NoiseLevel]:
    """Levels as the settings divide them; the last without noise (`set_alpha_to_one`)."""
    return schedule.levels(settings.step_count, settings.strength, settings.step_spacing)


def _consistency_levels(
    schedule: Schedule, original: int, settings: SamplerSettings, _: tuple[int, int]
) -> list[NoiseLevel]:
    """Levels of a consistency model: evenly among the `original` ones that it was distilled at.

    Raises UsageError for more steps than those below the strength.
    """
    stride = len(schedule.alphas_cumprod) // original
    count, steps = int(original * settings.strength), settings.step_count
    if steps > count:
        raise UsageError(
            f"this consistency model was distilled at {original} levels, of which strength "
            f"{settings.strength:g} leaves {count}: ask for at most {count} steps, not {steps}"
        )
    falling = [(count - i * count // steps) * stride - 1 for i in range(steps)]
    return [*(schedule.level(t) for t in falling), CLEAN]


def _edm(config: Mapping[str, Any], place: Path) -> Noise:
    """The noise of Karras et al. 2022: its levels are given by sigma, not by training steps."""
    predicts = _prediction(config, place, ("v_prediction",))
    if config.get("sigma_data", 0.5) != 1:
        raise InputError(
            f"{place}: sigma_data {config.get('sigma_data', 0.5)} is not 1, as in CosXL"
        )
    spacing = config.get("sigma_schedule", "karras")
    if spacing not in ("karras", "exponential"):
        raise InputError(f"{place}: sigma_schedule {spacing!r} is not karras or exponential")
    schedule = Schedule.edm(config.get("sigma_min", 0.002), config.get("sigma_max", 80.0))
    own: Spacing = "karras" if spacing == "karras" else "linspace"
    levels = partial(_edm_levels, schedule, dict(config))
    return Noise(schedule, predicts, levels, SamplerDefaults(spacing=own))


def _edm_levels(
    schedule: Schedule, config: Mapping[str, Any], settings: SamplerSettings, _: tuple[int, int]
) -> list[NoiseLevel]:
    """Levels of sigmas from that of the strength to the least one; the last as the scheduler's.

    karras: their roots of the order `rho` are evenly spaced. linspace: their logarithms are.
    """
    count, strength, spacing = settings.step_count, settings.strength, settings.step_spacing
    first, last = (schedule.level(t) for t in (schedule.t_max(strength) - 1, 0))
    if spacing == "karras":
        sigmas = karras_sigmas(first.sigma, last.sigma, count, config.get("rho", RHO))
        levels = [schedule.level_at(sigma) for sigma in sigmas]
    elif spacing == "linspace":
        logs = even(math.log(first.sigma), math.log(last.sigma), count)
        levels = [schedule.level_at(math.exp(log)) for log in logs]
    else:
        return schedule.levels(count, strength, spacing)
    return [*levels, levels[-1] if config.get("final_sigmas_type") == "sigma_min" else CLEAN]
