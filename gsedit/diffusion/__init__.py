"""Diffusion sampling with consensus between views: any denoiser, schedule and solver.

A denoiser predicts; `levels_of` says between which noise levels to step; `sample` yields a state a
step. Conventions: latents are [v c y x], `t` a training step, x_t = a x0 + b noise.
"""

from __future__ import annotations

from gsedit.diffusion.denoisers import Answer, Denoiser, Predictor
from gsedit.diffusion.guidance import Branches, Need, guide, needed
from gsedit.diffusion.predictions import Pair, Prediction, as_pair
from gsedit.diffusion.sample import (
    Anchor,
    Hook,
    State,
    add_noise,
    levels_of,
    predict_guided,
    sample,
)
from gsedit.diffusion.schedules import CLEAN, NoiseLevel, Schedule, Spacing, karras_sigmas
from gsedit.diffusion.settings import (
    Noise,
    Precision,
    SamplerSettings,
    Solver,
    Suits,
    Target,
    suits,
)

__all__ = [
    "CLEAN",
    "Anchor",
    "Answer",
    "Branches",
    "Denoiser",
    "Hook",
    "Need",
    "Noise",
    "NoiseLevel",
    "Pair",
    "Precision",
    "Prediction",
    "Predictor",
    "SamplerSettings",
    "Schedule",
    "Solver",
    "Spacing",
    "State",
    "Suits",
    "Target",
    "add_noise",
    "as_pair",
    "guide",
    "karras_sigmas",
    "levels_of",
    "needed",
    "predict_guided",
    "sample",
    "suits",
]
