"""Gradients of a picture by every input, for the laws of the renderer."""

from __future__ import annotations

from dataclasses import replace

import torch
from closeness import INPUTS, leaves, relative, tensors, weights_like

from rasterizer import Camera, Gaussians, Numerics

WHOLE_SUM = Numerics(transmittance_min=0.0)


SEEDS = (11, 12, 13)


BACKGROUND = torch.tensor((0.2, 0.5, 0.9), dtype=torch.float64)


def gradients(function, scene: Gaussians, camera: Camera, **options) -> dict[str, torch.Tensor]:
    """Gradients of a loss that hides no pixel, by every input: the pose and the background too."""
    inputs, pose = leaves(scene), camera.world_to_camera.clone().requires_grad_()
    background = BACKGROUND.clone().requires_grad_()
    view = replace(camera, world_to_camera=pose)
    picture = function(inputs, view, background=background, **options)
    loss = (picture.color * weights_like(picture.color)).sum()
    loss = loss + (picture.alpha * weights_like(picture.alpha, 1)).sum()
    wanted = [*tensors(inputs), pose, background]
    found = torch.autograd.grad(loss, wanted, allow_unused=True, materialize_grads=True)
    return dict(zip((*INPUTS, "pose", "background"), found))


def largest_difference(found: dict[str, torch.Tensor], wanted: dict[str, torch.Tensor]) -> float:
    """Largest relative difference of an input's gradients."""
    return max(relative(found[of], wanted[of]) for of in wanted)
