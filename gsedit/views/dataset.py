"""Pictures with cameras: photos from disk, or renders of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class View:
    """One picture and the camera that took it."""

    name: str
    camera: Camera
    image: Float[Tensor, "h w 3"]
    """sRGB in [0, 1]; as many pixels as the camera has."""


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
