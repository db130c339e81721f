"""How much work a picture is, counted in pairs: counts of two renderers can be compared.

A pair is a Gaussian in a tile's list, a pixel-pair a Gaussian at a pixel of such a tile.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer import Camera, Execution, Gaussians, Numerics
from rasterizer.blending.choose import choose_backend
from rasterizer.numerics import AUTO, DEFAULT
from rasterizer.preprocess import preprocess, stored_scene
from rasterizer.splat import list_tiles
from rasterizer.tiles import Bins


class BinnedGaussians(NamedTuple):
    """2D Gaussians, and the Gaussians of each tile: as `splat` lists them."""

    xy: Float[Tensor, "n 2"]
    whitening: Float[Tensor, "n 3"]
    log_opacities: Float[Tensor, " n"]
    bins: Bins


def bin_gaussians(
    scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT, execution: Execution = AUTO
) -> BinnedGaussians:
    """The visible Gaussians of a scene, on the picture and in its tiles."""
    box = (0, 0, camera.width, camera.height)
    splats = preprocess(stored_scene(scene), camera, box, numerics)
    backend = choose_backend(execution, scene.means.device, scene.means.dtype)
    xy, bins = list_tiles(splats, box, numerics, execution, backend)
    return BinnedGaussians(xy, splats.projected.whitening, splats.log_opacities, bins)


@torch.no_grad()
def listed_pairs(
    scene: Gaussians, camera: Camera, numerics: Numerics = DEFAULT, execution: Execution = AUTO
) -> tuple[int, int]:
    """(tile, Gaussian) pairs, and their pixels: what a renderer without early stop evaluates."""
    bins = bin_gaussians(scene, camera, numerics, execution).bins
    tiled = len(bins.members)
    return tiled, tiled * bins.size**2
