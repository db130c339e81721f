"""A picture as a linear map of colors: the blending weights of a view, with geometry fixed.

`n` Gaussians, of which a view may show `m`; a picture of `h w` pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.blending.backend import GEOMETRY, Backend, BlendInputs
from rasterizer.blending.choose import choose_backend
from rasterizer.blending.cpp_backend import BACKEND
from rasterizer.camera import Camera
from rasterizer.cpp_projection.kernel import Request
from rasterizer.cpp_projection.picture import prepare
from rasterizer.numerics import AUTO, DEFAULT, Execution, Numerics, ruling
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
    """Its last three columns are written by every product."""
    _backend: Backend
    wanted: Float[Tensor, "h w"] | None = None
    """How much pixels count: pictures may be black, and maps are 0, where it is 0. None: alike."""

    def picture(self, colors: Float[Tensor, "n 3"]) -> Float[Tensor, "h w 3"]:
        """W times the colors, over black; colors may have either sign."""
        return self.picture_of_rows(colors.index_select(0, self.rows))

    def back(self, maps: Float[Tensor, "h w 3"]) -> Float[Tensor, "n 3"]:
        """The transpose of W times three maps of the picture."""
        pulled = self.back_to_rows(maps)
        return pulled.new_zeros(self.count, 3).index_copy_(0, self.rows, pulled)

    def picture_of_rows(self, colors: Float[Tensor, "m 3"]) -> Float[Tensor, "h w 3"]:
        """W times the colors of `rows`; no other Gaussian shows."""
        self._inputs.table[:, GEOMETRY:] = colors
        inputs = self._inputs._replace(wanted=self.wanted)
        return self._backend.forward(inputs, False, False).blended.features

    def back_to_rows(self, maps: Float[Tensor, "h w 3"]) -> Float[Tensor, "m 3"]:
        """The rows of `back` that are not zero."""
        shape = (self._inputs.height, self._inputs.width, 3)
        if tuple(maps.shape) != shape:
            raise ValueError(f"maps have shape {tuple(maps.shape)}, the picture's is {shape}")
        inputs = self._inputs._replace(wanted=self.wanted)
        return self._backend.pull(inputs, maps.to(inputs.table).contiguous())


@torch.no_grad()
def color_weights(
    scene: Gaussians, camera: Camera, *, numerics: Numerics = DEFAULT, execution: Execution = AUTO
) -> ColorWeights:
    """The weights of a view, from the scene's geometry and opacities; its colors are not read.

    Raises ValueError as `render` does.
    """
    box, execution = (0, 0, camera.width, camera.height), ruling(execution)
    bare = replace(scene, sh=scene.sh[:, :0])
    found = prepare(bare, Request(camera, box, numerics, execution))
    if found is not None:
        listed = found.listed
        rows, table, bins, backend = listed.rows.long(), listed.table, listed.bins, BACKEND
    else:
        backend = choose_backend(execution, scene.means.device, scene.means.dtype)
        splats = preprocess(stored_scene(scene), camera, box, numerics)
        xy, bins = list_tiles(splats, box, numerics, execution, backend)
        rows, projected = splats.rows, splats.projected
        table = torch.cat((xy, projected.whitening, splats.log_opacities[:, None]), -1)
    table = torch.cat((table, table.new_zeros(len(table), 3)), -1)
    inputs = BlendInputs(table, bins, camera.width, camera.height, numerics)
    return ColorWeights(rows, len(scene), inputs, backend)
