"""Anchors of GaussianEditor (Chen et al. 2024): attributes are drawn back to where they were.

Its hierarchical Gaussian splatting adds the penalty

    weight * growth(step) * sum over attributes P of lambda_P * mean((P - P0)^2),

the mean over the Gaussians that move and over the values of each, as in the published code, as are
the lambda_P (`configs/edit-n2n.yaml`). growth is that of the Gaussians with which an edit begins:
0.05, times 1.3 every 100 steps (at its densifications), at most 10. No Gaussian is added here, so
that there is one generation, and P0 is the unedited scene; the published code moves P0 to the
present value at every densification.

`n` Gaussians, of which a step has `m`.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Int
from torch import Tensor

LAMBDAS = {
    "sh": 5.0, "sh_rest": 5.0, "logit_opacities": 50.0, "log_scales": 50.0, "means": 50.0,
    "quats": 50.0,
}  # fmt: skip
"""By field, base colours apart from the view-dependent ones."""
FIRST, FACTOR, EVERY, LARGEST = 0.05, 1.3, 100, 10.0


def growth(step: int) -> float:
    """The weight of the anchors after so many steps."""
    return min(FIRST * FACTOR ** (step // EVERY), LARGEST)


class Anchors:
    """Where every value of every Gaussian is drawn to, and how strongly."""

    def __init__(self, weight: float, values: Mapping[str, Tensor]) -> None:
        """`weight` beside GaussianEditor's own, `values` by field, one row a Gaussian."""
        self.weight, self.values = weight, values

    @torch.no_grad()
    def add_gradient(
        self,
        gradients: Mapping[str, Tensor],
        present: Mapping[str, Tensor],
        rows: Int[Tensor, " m"] | None,
        moving: int,
        step: int,
    ) -> None:
        """Add the gradient of the penalty to the gradients of these rows (None: of all), in place.

        `moving` is the number of Gaussians that move in the whole scene. Gaussians without a
        gradient are left alone: what no picture shows in this step has nothing to be held against,
        and a step over few rows equals the step over all.
        """
        if not gradients:
            return
        drawn = torch.stack(
            [g.flatten(1).any(1) if g.ndim > 1 else g != 0 for g in gradients.values()]
        ).any(0)
        for name, gradient in gradients.items():
            start = self.values[name] if rows is None else self.values[name].index_select(0, rows)
            values = gradient[0].numel() * max(1, moving)
            scale = self.weight * growth(step) * LAMBDAS[name] * 2 / values
            shape = (-1, *(1,) * (gradient.ndim - 1))
            gradient += scale * drawn.view(shape) * (present[name].detach() - start)

    def selected(self, origin: Int[Tensor, " m"]) -> Anchors:
        """For other rows: row i is drawn to where row origin[i] is."""
        return Anchors(self.weight, {name: value[origin] for name, value in self.values.items()})
