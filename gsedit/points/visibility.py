"""What cameras see of each Gaussian: the strongest evidence of what is no part of a capture.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

SIZE = 128
"""Longer side of the renders, pixels. A Gaussian covers a few pixels even where it is small, as
renderers widen every one; larger pictures say the same and take longer."""


def most_seen(scene: Gaussians, cameras: Sequence[Camera]) -> Float[np.ndarray, " n"]:
    """The largest contribution of each Gaussian to one of the views, in pixels: its blending
    weights, summed over the picture."""
    from rasterizer.render import contributions

    most = scene.means.new_zeros(len(scene))
    for camera in cameras:
        scale = min(1.0, SIZE / max(camera.width, camera.height))
        size = (max(1, round(side * scale)) for side in (camera.width, camera.height))
        most = most.maximum(contributions(scene, camera.resized(*size)).to(most))
    return most.numpy()
