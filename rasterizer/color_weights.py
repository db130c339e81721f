"""A picture as a linear map of colors: the blending weights of a view, with geometry fixed.

`n` Gaussians, of which a view may show `m`; a picture of `h w` pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, Backend, BlendInputs
from rasterizer.blending.choose import choose_backend
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, DEFAULT, Execution, Numerics
from rasterizer.preprocess import preprocess, stored_scene
from rasterizer.scene import Gaussians
from rasterizer.splat import list_tiles


@dataclass(frozen=True, eq=False)
class ColorWeights:
    """The blending weights W of a view: its picture is W times the colors of the Gaussians.

    Projection, order and tiles are found once; a product then costs the blending alone.
    """

    rows: Int[Tensor, " m"]
    """Rows of the scene that the view may show."""
    count: int
    """Gaussians of the scene."""
    _inputs: BlendInputs
    _backend: Backend

    def picture(self, colors: Float[Tensor, "n 3"]) -> Float[Tensor, "h w 3"]:
        """W times the colors, over black; colors may have either sign."""
        own = colors.index_select(0, self.rows).to(self._inputs.table)
        table = torch.cat((self._inputs.table, own), 1)
        inputs = self._inputs._replace(table=table)
        return self._backend.forward(inputs, False, False).blended.features

    def back(self, maps: Float[Tensor, "h w 3"]) -> Float[Tensor, "n 3"]:
        """The transpose of W times three maps of the picture."""
        saved, transmittance = self._blended
        maps = maps.to(transmittance).contiguous()
        still = torch.zeros_like(transmittance)
        by_row = self._backend.backward(saved, transmittance, maps, still)[:, GEOMETRY:]
        return maps.new_zeros(self.count, 3).index_copy_(0, self.rows, by_row)

    @cached_property
    def _blended(self) -> tuple[Any, Float[Tensor, "h w"]]:
        """State that the backend's backward pass needs; it does not depend on the colors."""
        black = self._inputs.table.new_zeros(len(self.rows), 3)
        table = torch.cat((self._inputs.table, black), 1)
        blended, saved = self._backend.forward(self._inputs._replace(table=table), False, True)
        return saved, blended.transmittance


@torch.no_grad()
def color_weights(
    scene: Gaussians,
    camera: Camera,
    *,
    numerics: Numerics = DEFAULT,
    execution: Execution = AUTO,
) -> ColorWeights:
    """The weights of a view, from the scene's geometry and opacities; its colors are not read.

    Raises ValueError as `render` does.
    """
    box = (0, 0, camera.width, camera.height)
    backend = choose_backend(execution, scene.means.device, scene.means.dtype)
    splats = preprocess(stored_scene(scene), camera, box, numerics)
    xy, bins = list_tiles(splats, box, numerics, execution, backend)
    table = torch.cat((xy, splats.projected.whitening, splats.log_opacities[:, None]), -1)
    inputs = BlendInputs(table, bins, camera.width, camera.height, numerics, execution.block)
    return ColorWeights(splats.rows, len(scene), inputs, backend)
