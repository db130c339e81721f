"""How far two regions are the same."""

from __future__ import annotations

import torch


def iou(a: torch.Tensor, b: torch.Tensor, weight: torch.Tensor | None = None) -> float:
    """Intersection over union of two sets of Gaussians or pixels, each counted by its weight."""
    a, b = torch.as_tensor(a), torch.as_tensor(b)
    weight = torch.ones(a.shape) if weight is None else weight
    return float(weight[a & b].sum() / weight[a | b].sum())
