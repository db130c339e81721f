"""Light around a subject as its own shading tells it: brighter where pictures are clipped or blind.

A capture shows its surroundings up to white, and not the sky above. The subject's old shading was
made by that light: factors on the panorama, one for each of `d` directions, are fitted to it. They
stay near 1 where the panorama was seen well. `m` Gaussians of the subject.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.scene.color_space import LUMINANCE
from gsedit.surface.directions import cell_directions, look_up
from gsedit.surface.surroundings import CLIPPED_GAIN, Surroundings

SAMPLES = 2000
"""Gaussians that the factors are fitted to: those that fill the pictures most."""
PATCHES = 60.0
"""Patches of paint that differ by chance, as many as the samples count for together."""
PAINT = 0.3
"""Their standard deviation, as a share of the mean."""
ALBEDOS = np.geomspace(0.08, 0.8, 10)
USUAL_ALBEDO, ALBEDO_SPREAD = 0.35, 0.5
"""Albedo of things, and the standard deviation of its logarithm."""
STIFF, LOOSE = 12.0, 0.5
"""Weight of a factor's squared distance from 1 where the panorama was seen, and where it was not
or is clipped."""
LARGEST = 8.0
"""Largest factor of a direction."""
SHARPNESS = 20.0
"""Sharpness of a direction's factor over the panorama: half at 15 degrees."""


@dataclass(frozen=True, eq=False)
class Received:
    """Light that the subject received and showed."""

    color: Float[Tensor, "m 3"]
    """Linear light that each Gaussian sent to the cameras before."""
    share: Float[Tensor, "m d"]
    """Weight of each direction in what a Gaussian receives; sums to 1 where nothing is hidden."""
    weight: Float[Tensor, " m"]
    """How much each Gaussian counts."""


def as_shaded(
    surroundings: Surroundings, received: Received, directions: Float[Tensor, "d 3"]
) -> Surroundings:
    """The surroundings with the light that best explains the subject's shading, in the channel that
    its paint sends most of: a deep red is no dark grey."""
    rows = received.weight.argsort(descending=True, stable=True)[:SAMPLES]
    light = look_up(surroundings.radiance, directions) @ torch.from_numpy(LUMINANCE).to(directions)
    clipped = ((light - 0.6) / (0.5 * CLIPPED_GAIN)).clamp(0, 1)
    seen = look_up(surroundings.seen[..., None], directions)[:, 0] * (1 - clipped)
    stiff = (LOOSE + (STIFF - LOOSE) * seen).double().numpy()
    design = (received.share * light)[rows].double().numpy()
    factors = _fitted(design, received.color.amax(-1)[rows].double().numpy(), stiff)
    cells = cell_directions(len(surroundings.radiance)).to(directions)
    near = torch.exp(SHARPNESS * (cells @ directions.T - 1))
    smooth = (near @ torch.from_numpy(factors).to(near)) / near.sum(-1)
    return replace(surroundings, radiance=surroundings.radiance * smooth[..., None])


def are_too_dark(
    surroundings: Surroundings, received: Received, directions: Float[Tensor, "d 3"]
) -> bool:
    """Whether the subject is brighter than the lightest paint would be in its surroundings, as on a
    dark tile with nothing around."""
    light = look_up(surroundings.radiance, directions) @ torch.from_numpy(LUMINANCE).to(directions)
    most = ALBEDOS[-1] * (received.share @ light)
    luminance = received.color @ torch.from_numpy(LUMINANCE).to(directions)
    return float(((luminance - most) * received.weight).sum()) > 0


def _fitted(design: np.ndarray, shown: np.ndarray, stiff: np.ndarray) -> np.ndarray:
    """The factors of directions, at the albedo that makes them likeliest."""
    from scipy.optimize import nnls

    count = np.sqrt(PATCHES / len(shown)) / (PAINT * max(float(shown.mean()), 1e-4))
    best, least = np.ones(design.shape[1]), np.inf
    # errors within the design's column space, as small a system; the rest is the same for all
    basis, design = np.linalg.qr(design)
    shown = basis.T @ shown
    for albedo in ALBEDOS:
        system = np.concatenate((count * albedo * design, np.diag(np.sqrt(stiff))))
        wanted = np.concatenate((count * shown, np.sqrt(stiff)))
        factors, error = nnls(system, wanted)
        cost = error**2 + (np.log(albedo / USUAL_ALBEDO) / ALBEDO_SPREAD) ** 2
        if cost < least:
            best, least = factors, cost
    return best.clip(0, LARGEST)
