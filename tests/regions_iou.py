"""How far two regions are the same."""

from __future__ import annotations

import torch


def iou(a: torch.Tensor, b: torch.Tensor, weight: torch.Tensor) -> float:
    """Intersection over union of two sets of Gaussians, each counted by its weight."""
    return float(weight[a & b].sum() / weight[a | b].sum())
