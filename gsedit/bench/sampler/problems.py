"""Diffusion models whose ODE has an answer to any accuracy: what solvers are measured on.

`v` views, `k` components, `c y x` latents. q = x_t / a and sigma = b / a, as in the solvers. Under
each condition the data are a mixture of Gaussians of one width, so that the ODE stiffens as the
width narrows and as guidance, the difference of two scores, grows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.consistency.consensus import consensus, share_noise
from gsedit.consistency.correspond import Correspondences
from gsedit.diffusion import (
    Branches,
    Need,
    NoiseLevel,
    Prediction,
    SamplerSettings,
    Schedule,
    add_noise,
    levels_of,
    sample,
)
from gsedit.diffusion.guidance import weights
from gsedit.editors.closed_form import CELL, ClosedForm, Mixture
from gsedit.editors.protocol import EditBatch
from gsedit.editors.sampling import DiffusionEditor

TRUTH_STEPS = 10_000
"""Of the fourth-order method: its own error is then below 1e-10 for every problem here."""
SHAPE = (8, 2, 2, 2)  # views (each a point of its own), channels, cells
SPREAD = 1.0
"""Standard deviation of the components' centres, along each axis: that of the data as a whole."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The Predictor of three mixtures: what is told, what is shown, and neither."""

    told: Mixture
    shown: Mixture
    neither: Mixture
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "eps"
    dtype: torch.dtype | None = None
    """Of its answers, rounded as a network of that precision would; None: that of its input."""
    name: str = "mixture"

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The exact prediction of the kind that is promised."""
        level = self.schedule.level(t)
        q = x / level.a if level.a else torch.zeros_like(x)  # no signal: any q says as much
        clean = self.clean(q, level.sigma, need)

        def answered(x0: Tensor | None) -> Tensor | None:
            return None if x0 is None else self._as_promised(x0, x, level)

        return Branches(*map(answered, clean))

    def clean(self, q: Float[Tensor, "v c y x"], sigma: float, need: Need) -> Branches:
        """E[x0 | q] under each condition that is needed, computed in float64."""
        mixtures = (self.told, self.shown, self.neither)
        return Branches(
            *(
                mixture.posterior_mean(q.double(), sigma**2).to(q) if asked else None
                for mixture, asked in zip(mixtures, need)
            )
        )

    def _as_promised(self, x0: Tensor, x: Tensor, level: NoiseLevel) -> Tensor:
        eps = (x - level.a * x0) / level.b
        match self.predicts:
            case "eps":
                predicted = eps
            case "x0":
                predicted = x0
            case "v":
                predicted = level.a * eps - level.b * x0
            case "flow":
                predicted = eps - x0
        return predicted if self.dtype is None else predicted.to(self.dtype)


def problem(
    width: float,
    *,
    schedule: Schedule | None = None,
    predicts: Prediction = "eps",
    dtype: torch.dtype | None = None,
    shape: tuple[int, int, int, int] = SHAPE,
    seed: int = 0,
) -> Problem:
    """Three components of that width are told, those and three more are shown, and neither knows
    more than that data have unit variance. Every view has centres of its own.
    """
    generator = torch.Generator().manual_seed(seed)
    centres = SPREAD * torch.randn(6, *shape, generator=generator, dtype=torch.float64)

    def mixture(offsets: Tensor, width: float) -> Mixture:
        even = torch.full((shape[0], len(offsets)), -math.log(len(offsets)), dtype=torch.float64)
        return Mixture(torch.zeros(shape, dtype=torch.float64), offsets, even, width)

    return Problem(
        mixture(centres[:3], width),
        mixture(centres, width),
        mixture(torch.zeros_like(centres[:1]), 1.0),
        schedule or Schedule.scaled_linear(),
        predicts,
        dtype,
    )


def start(
    model: Problem, level: NoiseLevel, seed: int = 1, dtype: torch.dtype = torch.float64
) -> Float[Tensor, "v c y x"]:
    """A draw of the noised data: where sampling starts."""
    generator = torch.Generator().manual_seed(seed)
    centres = model.told.offsets
    noise = torch.randn(2, *centres[0].shape, generator=generator, dtype=torch.float64)
    clean = centres[0] + model.told.width * noise[0]
    return (level.a * clean + level.b * noise[1]).to(dtype)


def truth(
    model: Problem,
    x: Float[Tensor, "v c y x"],
    first: NoiseLevel,
    settings: SamplerSettings,
    last_sigma: float | None = None,
    steps: int = TRUTH_STEPS,
) -> Float[Tensor, "v c y x"]:
    """q at `last_sigma` on the guided ODE's path from x, float64; without it at no noise.

    The classical fourth-order Runge-Kutta method in log(sigma), where the ODE of one Gaussian has
    slopes between 0 and 1 however narrow it is. No noise is a ten-thousandth of the width: below,
    q moves by less than 1e-8 widths. Needs a first level with some signal.
    """
    s_T, s_I = settings.scales
    weighted = [
        (weight, mixture)
        for weight, mixture in zip(weights(s_T, s_I), (model.told, model.shown, model.neither))
        if weight != 0
    ]
    parts = [(weight, _components(mixture), mixture.width**2) for weight, mixture in weighted]
    end = 1e-4 * model.told.width if last_sigma is None else last_sigma

    def slope(q: Tensor, log_sigma: float) -> Tensor:
        variance = math.exp(2 * log_sigma)
        guided = sum(w * _mean(q, variance, *known, square) for w, known, square in parts)
        return q - guided

    q = x.double().flatten(1) / first.a
    found = _runge_kutta(slope, q, math.log(first.sigma), math.log(end), steps)
    return found.reshape(x.shape)


def _components(mixture: Mixture) -> tuple[Float[Tensor, "v k n"], Float[Tensor, "v k"]]:
    """(centres, log weights) in float64."""
    centres = (mixture.base + mixture.offsets).double().flatten(2).movedim(0, 1)
    return centres.contiguous(), mixture.log_weights.double()


def _mean(
    q: Tensor, variance: float, centres: Tensor, log_weights: Tensor, square: float
) -> Tensor:
    """E[x0 | q] as in the textbook, written a second time: the solvers' denoiser is checked too."""
    distance = (q[:, None] - centres).square().sum(-1)
    share = (log_weights - distance / (2 * (square + variance))).softmax(-1)
    centre = (share[:, None] @ centres).squeeze(1)
    return centre + square / (square + variance) * (q - centre)


def _runge_kutta(
    slope: Callable[[Tensor, float], Tensor], q: Tensor, first: float, last: float, steps: int
) -> Tensor:
    h = (last - first) / steps
    for i in range(steps):
        u = first + i * h
        k1 = slope(q, u)
        k2 = slope(q + h / 2 * k1, u + h / 2)
        k3 = slope(q + h / 2 * k2, u + h / 2)
        k4 = slope(q + h * k3, u + h)
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return q


# --- views that should agree ---


@dataclass(frozen=True, eq=False)
class Scene:
    """Overlapping views of one thing, with exact correspondences."""

    name: str
    originals: Float[Tensor, "v ..."]
    clusters: Int[Tensor, "v y x"]
    """Of the cells of the result; -1 for none."""
    cell: int
    """Pixels of the result per cell."""
    edit: Callable[[SamplerSettings, int], Float[Tensor, "v ..."]]
    """The edited views, [v h w c], for settings and a seed."""

    def disagreement(self, views: Float[Tensor, "v h w c"]) -> float:
        """RMS difference of corresponding pixels from their mean."""
        side = self.cell
        cells = views.unfold(1, side, side).unfold(2, side, side).flatten(3)  # v y x (c s s)
        flat, labels = cells.flatten(0, 2), self.clusters.flatten()
        seen = labels >= 0
        flat, labels = flat[seen], labels[seen].long()
        count = int(labels.max()) + 1
        total = flat.new_zeros(count, flat.shape[1]).index_add(0, labels, flat)
        members = labels.bincount(minlength=count).clamp_min(1)
        mean = total / members[:, None]
        return float((flat - mean[labels]).square().mean().sqrt())


def crops(views: int, side: int, shift: int) -> Int[Tensor, "v y x"]:
    """Clusters of views that each look `shift` cells further along both axes than the last."""
    y, x = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    wide = side + views * shift
    places = torch.stack([(y + v * shift) * wide + x + v * shift for v in range(views)])
    _, names, counts = places.unique(return_inverse=True, return_counts=True)
    return torch.where(counts[names] > 1, names, -1)


VIEWS = 4


def texture_scene(side: int = 24, shift: int = 2) -> Scene:
    """A texture: x0 is normal about what each view makes of it, as wide as data; editing.md 3.1.

    The toy in which averaging blurs: nothing snaps to an answer, so what is lost stays lost.
    """
    labels = crops(VIEWS, side, shift)
    shape = (VIEWS, 1, side, side)
    bias = 0.3 * torch.randn(shape, generator=torch.Generator().manual_seed(7))
    model = Texture(bias)

    def edit(settings: SamplerSettings, seed: int) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        share = partial(share_noise, labels=labels) if settings.noise == "shared" else None
        noise = torch.randn(shape, generator=generator)
        first = levels_of(model.schedule, settings)[0]
        x = add_noise(torch.zeros(shape), share(noise) if share else noise, first)
        *_, state = sample(
            model, None, x, settings,
            consensus=partial(consensus, labels=labels, strength=settings.consensus_strength),
            share=share, generator=generator,
        )  # fmt: skip
        return state.x.movedim(1, -1)

    return Scene("texture", torch.zeros(shape).movedim(1, -1), labels, 1, edit)


@dataclass(frozen=True, eq=False)
class Texture:
    """A Predictor: under every condition x0 is normal about `bias` with unit variance."""

    bias: Tensor
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "x0"
    name: str = "texture"

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        level = self.schedule.level(t)
        x0 = self.bias + level.a / (level.a**2 + level.b**2) * (x - level.a * self.bias)
        return Branches(*(x0 if asked else None for asked in need))


def picture_scene(side: int = 12, shift: int = 1) -> Scene:
    """Crops of one painted picture, edited by the closed-form editor, whose views differ in light,
    tint and place as editors' views do.
    """
    cell, wide = CELL, side + VIEWS * shift
    labels = crops(VIEWS, side, shift)
    y, x = torch.meshgrid(torch.arange(wide * cell), torch.arange(wide * cell), indexing="ij")
    waves = [torch.sin(x / 9 + 0.7), torch.sin(y / 7 + x / 31), torch.sin((x + y) / 5)]
    full = torch.stack(waves, -1) * 0.25 + 0.5
    step = shift * cell
    views = torch.stack(
        [full[v * step :, v * step :][: side * cell, : side * cell] for v in range(VIEWS)]
    )
    editor = DiffusionEditor(ClosedForm())
    matches = Correspondences(labels, torch.ones(VIEWS, VIEWS), cell)

    def edit(settings: SamplerSettings, seed: int) -> Tensor:
        batch = EditBatch(views, views, "turn it into bronze", matches, None, seed)
        *_, progress = editor.edit(batch, settings, torch.Generator().manual_seed(seed))
        assert progress.images is not None
        return progress.images

    return Scene("closed form", views, labels, cell, edit)


# --- a network, for its cost ---


@dataclass(frozen=True, eq=False)
class Network:
    """A Predictor with an untrained network: the arithmetic of a small UNet, and no more."""

    layers: torch.nn.Module
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "eps"
    name: str = "network"

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """As many views in one pass as there are branches needed, as editors do."""
        found = iter(self.layers(torch.cat([x] * sum(need))).chunk(sum(need)))
        return Branches(*(next(found) if asked else None for asked in need))


def network(channels: int = 96, depth: int = 4) -> Network:
    """Residual convolutions with normalisation; its last layer is small, so answers are, too."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)  # modules offer no generator for their initial weights
        middle = [
            layer
            for _ in range(depth)
            for layer in (
                torch.nn.GroupNorm(8, channels),
                torch.nn.SiLU(),
                torch.nn.Conv2d(channels, channels, 3, padding=1),
            )
        ]
        layers = torch.nn.Sequential(
            torch.nn.Conv2d(4, channels, 3, padding=1),
            *middle,
            torch.nn.Conv2d(channels, 4, 3, padding=1),
        )
    return Network(layers.eval())
