"""The picture of a tab: one scene, two with a wipe between them, or two beside each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics, color_to_sh
from rasterizer.project import Box
from rasterizer.render import render
from rasterizer.scene import Gaussians

BACKGROUND = (0.11, 0.12, 0.14)
"""Behind the scene: dark, and not the black of a hole."""
LINE = (255, 255, 255)
LINE_PIXELS = 2
"""Width of the line between two scenes."""
STRENGTH = 0.5
"""Share of the tint in the color of what is selected."""

BESIDE_SCALE = 0.55
"""Size of things where two scenes share the width: between all of them, and as large as before."""

Way = Literal["wipe", "beside"]


@dataclass(frozen=True, eq=False)
class DisplayState:
    """One or two scenes as a tab shows them."""

    scene: Gaussians | None = None
    numerics: Numerics = DEFAULT
    before: Gaussians | None = None
    """The scene to compare with: on the left."""
    way: Way = "wipe"
    wipe: float = 0.5
    """Place of the line from the left, as a share of the picture's width."""

    @property
    def count(self) -> int:
        """Number of the Gaussians that one picture draws."""
        return max((len(each) for each in (self.scene, self.before) if each is not None), default=0)

    def camera(self, camera: Camera) -> Camera:
        """The camera by which the scene is drawn: half as wide, and showing nearly as much, where
        two are beside each other."""
        if self.before is None or self.way == "wipe":
            return camera
        width = max(camera.width // 2, 1)
        fx, fy = BESIDE_SCALE * camera.fx, BESIDE_SCALE * camera.fy
        return replace(camera, fx=fx, fy=fy, cx=width / 2, width=width)


@torch.no_grad()
def picture(shown: DisplayState, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """Draw what is shown; without a scene the background."""
    height, width = camera.height, camera.width
    if shown.scene is None:
        return np.broadcast_to(_bytes(torch.tensor(BACKGROUND)), (height, width, 3)).copy()
    if shown.before is None:
        return _bytes(_drawn(shown, shown.scene, camera, (0, 0, width, height)))
    if shown.way == "beside":
        half = shown.camera(camera)
        box = (0, 0, half.width, half.height)
        left, right = (_drawn(shown, each, half, box) for each in (shown.before, shown.scene))
        gap = torch.ones(height, width - 2 * half.width, 3)
        split, joined = half.width, _bytes(torch.cat((left, right, gap), 1))
    else:
        split = round(shown.wipe * width)
        parts = []
        for each, start, end in ((shown.before, 0, split), (shown.scene, split, width)):
            if end > start:
                parts.append(_drawn(shown, each, camera, (start, 0, end - start, height)))
        joined = _bytes(torch.cat(parts, 1))
    if 0 < split < width:
        joined[:, max(split - LINE_PIXELS // 2, 0) : split + LINE_PIXELS // 2] = LINE
    return joined


def tinted(
    scene: Gaussians, flags: Bool[Tensor, " n"], color: tuple[float, float, float]
) -> Gaussians:
    """The scene with the flagged Gaussians mixed with a color, in [0, 1]."""
    sh = scene.sh.clone()
    sh[flags] *= 1 - STRENGTH
    sh[flags, 0] += STRENGTH * color_to_sh(torch.tensor(color)).to(sh)
    return replace(scene, sh=sh)


def depth_at(scene: Gaussians, camera: Camera, x: float, y: float, numerics: Numerics) -> float:
    """Depth along the view of what is seen at a pixel, world units; 0 where nothing is."""
    column = min(max(int(x), 0), camera.width - 1)
    row = min(max(int(y), 0), camera.height - 1)
    drawn = render(scene, camera, crop=(column, row, 1, 1), median_depth=True, numerics=numerics)
    assert drawn.median_depth is not None  # it was asked for
    return float(drawn.median_depth)


def _drawn(
    shown: DisplayState, scene: Gaussians, camera: Camera, box: Box
) -> Float[Tensor, "h w 3"]:
    background = torch.tensor(BACKGROUND).to(scene.means)
    return render(scene, camera, background=background, crop=box, numerics=shown.numerics).color


def _bytes(color: Tensor) -> np.ndarray:
    return (color.clamp(0, 1) * 255 + 0.5).byte().numpy()
