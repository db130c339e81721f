"""Pictures with cameras: photos read from disk, cameras placed by us, and renders of a scene."""

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
    """One picture and where it was taken from."""

    name: str
    camera: Camera
    image: Float[Tensor, "h w 3"]
    """sRGB values in [0, 1]; h and w are the camera's."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """Posed pictures of one scene, and the sparse points they came with, if any."""

    views: tuple[View, ...]
    points: Float[Tensor, "n 3"] | None = None
    """World positions, same frame as the cameras."""
    point_colors: Float[Tensor, "n 3"] | None = None
    """In [0, 1]."""
    source: Path | None = None

    def __len__(self) -> int:
        return len(self.views)

    def split(self, every: int = 8) -> tuple[tuple[View, ...], tuple[View, ...]]:
        """(training, held out): every `every`-th view, counted from the first, is held out."""
        held_out = self.views[::every]
        return tuple(v for i, v in enumerate(self.views) if i % every), held_out


def evenly_spaced(count: int, at_most: int) -> list[int]:
    """Indices of at most `at_most` of `count` things, in order, the first among them."""
    chosen = min(count, at_most)
    return [index * count // chosen for index in range(chosen)]


@torch.no_grad()
def capture(
    scene: Gaussians,
    cameras: Sequence[Camera],
    names: Sequence[str],
    execution: Execution = AUTO,
) -> tuple[View, ...]:
    """Pictures of a scene from some cameras, clamped to [0, 1]."""
    return tuple(
        View(name, camera, render(scene, camera, execution=execution).color.clamp(0, 1))
        for name, camera in zip(names, cameras, strict=True)
    )
