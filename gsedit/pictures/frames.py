"""Frames of an animation: maps as 8-bit pictures side by side, all in one depth scale."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, tau

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from gsedit.formats.pictures import eight_bits
from gsedit.pictures import MapName
from gsedit.pictures.maps import SOLID, Maps, depth_colors, depth_range, render_maps, wipe
from gsedit.views.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.scene import Gaussians

PROBES, PROBE_SIZE = 8, 96
"""Frames, and the longer side of their renders in pixels, that decide an animation's depth
scale."""


@dataclass(frozen=True, eq=False)
class Animation:
    """Pictures along a path of cameras of one size."""

    scene: Gaussians
    cameras: tuple[Camera, ...]
    show: tuple[MapName, ...] = ("color",)
    wiped: Gaussians | None = None
    """A second scene, parted from the first by a vertical line; then only color is shown."""
    moving: bool = True
    """Whether the line moves; else it is in the middle."""
    background: Float[Tensor, "3"] | None = None
    numerics: tuple[Numerics, Numerics] = (DEFAULT, DEFAULT)
    """Numerics of the scene and of the second one: `antialiased` where it was trained so."""

    def __len__(self) -> int:
        return len(self.cameras)

    def frames(self) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """The frames, each rendered when it is asked for; their depths have one scale."""
        near_far = None
        if "depth" in self.show and self.wiped is None:
            near_far = depth_scale(self.scene, self.cameras, self.numerics[0])
        return (self.frame(index, near_far) for index in range(len(self)))

    def frame(
        self, index: int, near_far: tuple[float, float] | None = None
    ) -> UInt8[np.ndarray, "h w 3"]:
        """One frame; `near_far` are the ends of the depth scale (None: the frame's own)."""
        if self.wiped is not None:
            picture = wipe(
                self.scene, self.wiped, self.cameras[index], self.share(index),
                background=self.background, numerics=self.numerics,
            )  # fmt: skip
            return eight_bits(picture)
        return panels(self.maps(index), self.show, near_far)

    def maps(self, index: int) -> Maps:
        """The maps of one frame that are shown."""
        return render_maps(
            self.scene, self.cameras[index], self.show, background=self.background,
            numerics=self.numerics[0],
        )  # fmt: skip

    def share(self, index: int) -> float:
        """Share of a frame's width that shows the first scene: 1 to 0 and back."""
        return (1 + cos(tau * index / len(self))) / 2 if self.moving else 0.5


def panels(
    maps: Maps, show: Sequence[MapName], near_far: tuple[float, float] | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """The shown maps side by side; `near_far` are the ends of the depth scale (None: its own)."""
    return np.concatenate([_panel(maps, name, near_far) for name in show], 1)


def depth_scale(
    scene: Gaussians, cameras: Sequence[Camera], numerics: Numerics = DEFAULT
) -> tuple[float, float]:
    """The near and far ends of a color scale for all frames, from small renders of some."""
    depths, alphas = [], []
    for index in evenly_spaced(len(cameras), PROBES):
        small = cameras[index].fitted(PROBE_SIZE)
        maps = render_maps(scene, small, ("depth",), numerics=numerics)
        assert maps.depth is not None
        depths.append(maps.depth)
        alphas.append(maps.alpha)
    return depth_range(torch.cat(depths), torch.cat(alphas))


def normal_colors(maps: Maps) -> UInt8[np.ndarray, "h w 3"]:
    """Normals as colors: red right, green up, blue towards the viewer, -1 to 1; black where less
    than half of a pixel is covered."""
    assert maps.normals is not None
    return eight_bits((maps.normals / 2 + 0.5) * (maps.alpha > SOLID)[..., None])


def _panel(
    maps: Maps, name: MapName, near_far: tuple[float, float] | None
) -> UInt8[np.ndarray, "h w 3"]:
    match name:
        case "depth":
            assert maps.depth is not None
            near, far = near_far or depth_range(maps.depth, maps.alpha)
            return depth_colors(maps.depth, maps.alpha, near, far)
        case "normals":
            return normal_colors(maps)
        case "alpha":
            return np.repeat(eight_bits(maps.alpha)[..., None], 3, -1)
    return eight_bits(maps.color)
