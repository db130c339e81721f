"""Diffusion sampling with consensus between views: any denoiser, schedule and solver.

A `Predictor` predicts; `levels_of` lists the noise levels to step between; `sample` yields the
latents after every step. Latents are [v c y x], `t` is a training step, x_t = a x0 + b noise.
Each name is imported when it is first used, so that the settings load no torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.diffusion.guidance import Branches, Need, guide, needed
    from gsedit.diffusion.predictions import Pair, Prediction, as_pair
    from gsedit.diffusion.predictor import Predictor
    from gsedit.diffusion.sampler import (
        Anchor,
        Hook,
        SamplerStep,
        add_noise,
        levels_of,
        predict_guided,
        sample,
    )
    from gsedit.diffusion.schedules import CLEAN, NoiseLevel, Schedule, karras_sigmas
    from gsedit.diffusion.settings import (
        Noise,
        Precision,
        SamplerDefaults,
        SamplerSettings,
        Solver,
        Spacing,
        Target,
    )

__all__ = [
    "CLEAN",
    "Anchor",
    "Branches",
    "Hook",
    "Need",
    "Noise",
    "NoiseLevel",
    "Pair",
    "Precision",
    "Prediction",
    "Predictor",
    "SamplerDefaults",
    "SamplerSettings",
    "SamplerStep",
    "Schedule",
    "Solver",
    "Spacing",
    "Target",
    "add_noise",
    "as_pair",
    "guide",
    "karras_sigmas",
    "levels_of",
    "needed",
    "predict_guided",
    "sample",
]

make_lazy(
    __name__,
    {
        "guidance": ("Branches", "Need", "guide", "needed"),
        "predictions": ("Pair", "Prediction", "as_pair"),
        "predictor": ("Predictor",),
        "sampler": (
            "Anchor",
            "Hook",
            "SamplerStep",
            "add_noise",
            "levels_of",
            "predict_guided",
            "sample",
        ),
        "schedules": ("CLEAN", "NoiseLevel", "Schedule", "karras_sigmas"),
        "settings": (
            "Noise",
            "Precision",
            "SamplerDefaults",
            "SamplerSettings",
            "Solver",
            "Spacing",
            "Target",
        ),
    },
)
