"""A network of fixed random weights, for tests of memory and precision.

`v` views, `c y x` latents.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.paper.diffusion.guidance import Branches, Need, Prediction
from gsedit.paper.diffusion.schedules import Schedule


@dataclass(frozen=True, eq=False)
class UntrainedNetwork:
    """A Predictor with the arithmetic of a small UNet; its predictions mean nothing."""

    layers: torch.nn.Module
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    predicts: Prediction = "eps"
    name: str = "network"

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """All branches that are needed in one pass, as editors do."""
        predictions = iter(self.layers(torch.cat([x] * sum(need))).chunk(sum(need)))
        return Branches(*(next(predictions) if needed else None for needed in need))


def untrained_network(channels: int = 96, depth: int = 4) -> UntrainedNetwork:
    """Convolutions with normalisation from 4 channels to 4, with the same random weights always."""
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
    return UntrainedNetwork(layers.eval())
