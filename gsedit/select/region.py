"""The Gaussians that an edit may change, as pictures and as a file.

`n` Gaussians; pictures of `h w` pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.formats import flags
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians

TINT = (1.0, 0.1, 0.6)
"""Color of the inside in pictures for a person, which few captures have."""
TINT_STRENGTH = 0.55


@dataclass(frozen=True, eq=False)
class Region:
    """The Gaussians that an edit may change."""

    inside: Bool[Tensor, " n"]
    """The Gaussians that may change."""
    note: str = ""
    """How it was found, for a person."""
    how: str = ""
    """The expression that finds it again (gsedit.select.where)."""
    sure: float = 1.0
    """Share of what was seen, drawn or clicked that says so, in [0, 1]."""

    def __str__(self) -> str:
        return f"{self.note}; {int(self.inside.sum()):,} of {len(self.inside):,} Gaussians"

    @property
    def is_all(self) -> bool:
        """Whether nothing is outside."""
        return bool(self.inside.all())


def everything(scene: Gaussians) -> Region:
    """The region of all Gaussians."""
    return Region(torch.ones(len(scene), dtype=torch.bool), "all", "all()")


@torch.no_grad()
def coverage(
    region: Region, scene: Gaussians, camera: Camera, execution: Execution = AUTO
) -> Float[Tensor, "h w"]:
    """The share of each pixel that comes from the region's Gaussians: the sum of their blending
    weights, in [0, 1]. What is left comes from the other Gaussians and the background.
    """
    if region.is_all:
        return torch.ones(camera.height, camera.width, dtype=scene.means.dtype)
    return render(in_one_color(scene, region.inside), camera, execution=execution).color[..., 0]


def in_one_color(scene: Gaussians, values: Bool[Tensor, " n"] | Float[Tensor, " n"]) -> Gaussians:
    """The scene in greys from every direction: `values` in [0, 1], one a Gaussian."""
    grey = color_to_sh(values.to(scene.sh))
    return replace(scene, sh=grey[:, None, None].expand(-1, 1, 3))


def composite(
    edited: Float[Tensor, "h w 3"],
    unedited: Float[Tensor, "h w 3"],
    covered: Float[Tensor, "h w"],
) -> Float[Tensor, "h w 3"]:
    """The edited picture inside the region, the unedited one outside, mixed by `covered`."""
    return torch.lerp(unedited, edited, covered[..., None].to(edited))


def tinted(scene: Gaussians, region: Region) -> Gaussians:
    """The scene with the Gaussians inside the region tinted, for a person to look at."""
    tint = color_to_sh(torch.tensor(TINT)).to(scene.sh)
    sh = scene.sh.clone()
    sh[region.inside] *= 1 - TINT_STRENGTH
    sh[region.inside, 0] += TINT_STRENGTH * tint
    return replace(scene, sh=sh)


def save_region(region: Region, path: Path | str, *, overwrite: bool = False) -> None:
    """Write one flag a Gaussian, in the order of the scene's file: a .npy file of booleans."""
    flags.write_flags(region.inside.cpu().numpy(), path, overwrite=overwrite)


def read_flags(path: Path, count: int) -> Bool[Tensor, " n"]:
    """The flags of a .npy file, booleans or numbers (0: outside) for `count` Gaussians.

    Raises InputError for a file that is missing, damaged, or of another number of Gaussians.
    """
    return torch.from_numpy(flags.read_flags(path, count))
