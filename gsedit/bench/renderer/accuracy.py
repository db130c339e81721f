"""How far a picture and its gradients are from the reference's.

`n` Gaussians, `h w` pixels. Gradients are of the picture's dot product with fixed random weights,
to which every pixel contributes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer import Camera, Gaussians
from rasterizer.project import Box
from rasterizer.reference import render_reference

FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")
POSE = "pose"

Draw = Callable[[Gaussians, Camera], Float[Tensor, "h w 3"]]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A picture, and its gradients: of `FIELDS` of the scene, perhaps of `POSE`."""

    picture: Float[Tensor, "h w 3"]
    gradients: dict[str, Tensor]


@dataclass(frozen=True)
class Errors:
    """Absolute errors of colors over all pixels and channels, and errors of gradients."""

    mean: float
    largest: float
    gradient: float | None = None
    """Relative error of the worst input: |difference| / |reference|."""


def differentiate(draw: Draw, scene: Gaussians, camera: Camera, *, pose: bool = False) -> Drawn:
    """Draw a picture and its gradients, in the scene's dtype; `pose`: by the camera's pose too.

    The compiled front end does not draw what a pose takes gradients of: with `pose` it is not what
    is measured.
    """
    leaves = scene.map(lambda t: t.detach().requires_grad_())
    inputs = {field: getattr(leaves, field) for field in FIELDS}
    if pose:
        inputs[POSE] = camera.world_to_camera.detach().requires_grad_()
        camera = replace(camera, world_to_camera=inputs[POSE])
    picture = draw(leaves, camera)
    weights = torch.randn(picture.shape, generator=torch.Generator().manual_seed(0))
    loss = (picture * weights.to(picture)).sum()
    gradients = torch.autograd.grad(
        loss, tuple(inputs.values()), allow_unused=True, materialize_grads=True
    )
    return Drawn(picture.detach(), dict(zip(inputs, gradients)))


def with_pose(drawn: Drawn, draw: Draw, scene: Gaussians, camera: Camera) -> Drawn:
    """Add the gradient of the pose, from a second picture."""
    second = differentiate(draw, scene, camera, pose=True)
    return replace(drawn, gradients={**drawn.gradients, POSE: second.gradients[POSE]})


def errors(drawn: Drawn, expected: Drawn) -> Errors:
    """Errors of a picture, and of the gradients that `drawn` has."""
    error = (drawn.picture.double() - expected.picture.double()).abs()
    gradients = (
        relative(gradient.double(), expected.gradients[name].double())
        for name, gradient in drawn.gradients.items()
    )
    return Errors(float(error.mean()), float(error.max()), max(gradients, default=None))


def relative(value: Float[Tensor, "..."], expected: Float[Tensor, "..."]) -> float:
    """|value - expected| / |expected| as vectors; where the expected one is zero, |value|."""
    scale = float(expected.norm())
    return float((value - expected).norm()) / (scale or 1.0)


def reference_of(scene: Gaussians, camera: Camera, crop: Box | None = None) -> Drawn:
    """Picture, or a crop of it, and gradients of the float64 reference, which is slow."""
    left, top, width, height = crop or (0, 0, camera.width, camera.height)
    here = slice(top, top + height), slice(left, left + width)
    return differentiate(
        lambda s, c: render_reference(s, c).color[here], scene.to(torch.float64), camera, pose=True
    )
