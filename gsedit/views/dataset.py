"""Pictures with cameras: photos from disk, or renders of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.image_ops import downscale
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians

LEAST_SHARE = 1e-4
"""Of a pixel that is hidden by a mask for the pixel to be hidden: above what rounding leaves."""


@dataclass(frozen=True, eq=False)
class View:
    """One picture and the camera that took it."""

    name: str
    camera: Camera
    image: Float[Tensor, "h w 3"]
    """sRGB in [0, 1]; as many pixels as the camera has. What is transparent is laid over black, as
    renders are."""
    mask: Bool[Tensor, "h w"] | None = None
    """True where the photo says what the scene looks like; None: everywhere. A fit takes nothing
    from the other pixels, and measures nothing there."""
    alpha: Float[Tensor, "h w"] | None = None
    """Opacity of the photo, in [0, 1]; None: opaque. Where it is below 1 the scene is to be as
    transparent."""

    def over(self, background: Float[Tensor, "3"]) -> Float[Tensor, "h w 3"]:
        """The picture in front of a colour, which shows where the photo is transparent."""
        image, alpha = self.image, self.alpha
        return image if alpha is None else image + (1 - alpha)[..., None] * background

    def resized(self, width: int, height: int) -> View:
        """The view on so many pixels, each the mean of those under it; supervised where all are."""
        if (width, height) == (self.camera.width, self.camera.height):
            return self
        image = downscale(self.image, width, height).clamp(0, 1)
        mask, alpha = self.mask, self.alpha
        if mask is not None:
            hidden = downscale((~mask)[..., None].float(), width, height)[..., 0]
            mask = hidden < LEAST_SHARE
        if alpha is not None:
            alpha = downscale(alpha[..., None], width, height)[..., 0].clamp(0, 1)
        return View(self.name, self.camera.resized(width, height), image, mask, alpha)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Posed pictures of one scene, and sparse points of it, if there are any."""

    views: tuple[View, ...]
    points: Float[Tensor, "n 3"] | None = None
    """World positions, in the cameras' frame and units."""
    point_colors: Float[Tensor, "n 3"] | None = None
    """RGB in [0, 1]."""
    source: Path | None = None
    """The folder or file that it was read from."""

    def __len__(self) -> int:
        return len(self.views)

    def split(self, every: int = 8) -> tuple[tuple[View, ...], tuple[View, ...]]:
        """(training, held out): every `every`-th view, counted from the first, is held out."""
        held_out = self.views[::every]
        return tuple(v for i, v in enumerate(self.views) if i % every), held_out


def evenly_spaced(count: int, at_most: int) -> list[int]:
    """At most `at_most` evenly spaced ones of the indices 0 to `count` - 1, 0 among them."""
    number = min(count, at_most)
    return [index * count // number for index in range(number)]


@torch.no_grad()
def capture(
    scene: Gaussians,
    cameras: Sequence[Camera],
    names: Sequence[str],
    execution: Execution = AUTO,
) -> tuple[View, ...]:
    """Renders of a scene as views, clamped to [0, 1]; one name for each camera."""
    return tuple(
        View(name, camera, render(scene, camera, execution=execution).color.clamp(0, 1))
        for name, camera in zip(names, cameras, strict=True)
    )
