"""Contents of a page in the browser: splats in layers that can be switched, and cameras.

A browser draws base colors (SH degree 0) only. `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.pictures.viewer.point_clouds import splat_colors
from gsedit.select.region import TINT, TINT_STRENGTH
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, eq=False)
class Splats:
    """Gaussians as a browser takes them."""

    means: Float32[np.ndarray, "n 3"]
    covariances: Float32[np.ndarray, "n 3 3"]
    colors: Float32[np.ndarray, "n 3"]
    """RGB in [0, 1]."""
    opacities: Float32[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.means)


@dataclass(frozen=True, eq=False)
class Layer:
    """Splats that are shown together."""

    name: str
    splats: Splats
    scenes: tuple[str, ...]
    """While which of the scenes is shown: BEFORE, AFTER or both."""
    tinted: bool | None = None
    """Shown only with the region tinted (True), only without (False), or always (None)."""

    def is_shown(self, scene: str, tinted: bool) -> bool:
        return scene in self.scenes and self.tinted in (None, tinted)


def splats_of(scene: Gaussians) -> Splats:
    """Centers, covariances, base colors and opacities, float32."""
    scene = scene.detach()
    factor = rotation_matrices(scene.quats) * scene.scales[:, None]
    covariances = factor @ factor.mT
    arrays = (scene.means, covariances, splat_colors(scene), scene.opacities)
    return Splats(*(array.float().cpu().numpy() for array in arrays))


def make_layers(
    before: Gaussians,
    after: Gaussians | None = None,
    region: Bool[Tensor, " m"] | None = None,
) -> list[Layer]:
    """The layers of one or two scenes, none of them empty.

    Gaussians that an edit left as they were, in the same row of both scenes, are in the page once.
    A `region` holds for the scene of as many Gaussians; its Gaussians are there twice, plain and
    tinted. Raises UsageError for a region of another number of Gaussians.
    """
    scenes = {BEFORE: before} if after is None else {BEFORE: before, AFTER: after}
    if region is not None and len(region) not in {len(scene) for scene in scenes.values()}:
        counts = " and ".join(f"{len(scene)}" for scene in scenes.values())
        raise UsageError(
            f"the region has {len(region)} flags and the scene {counts} Gaussians: it belongs to "
            "another scene"
        )
    same = torch.zeros(len(before), dtype=torch.bool)
    if after is not None and len(after) == len(before):
        same = unchanged(before, after)
    layers = _split("both", before, same, (BEFORE, AFTER), region)
    for name, scene in scenes.items():
        own = ~same if len(scene) == len(before) else torch.ones(len(scene), dtype=torch.bool)
        layers += _split(name, scene, own, (name,), region)
    return [layer for layer in layers if len(layer.splats)]


def unchanged(before: Gaussians, after: Gaussians) -> Bool[Tensor, " n"]:
    """The rows that look the same in a browser: all but the coefficients of higher harmonics."""
    rows = (before.sh[:, 0] == after.sh[:, 0]).all(1)
    rows &= before.logit_opacities == after.logit_opacities
    for name in ("means", "quats", "log_scales"):
        rows &= (getattr(before, name) == getattr(after, name)).all(1)
    return rows


def _split(
    name: str,
    scene: Gaussians,
    rows: Bool[Tensor, " n"],
    shown: tuple[str, ...],
    region: Bool[Tensor, " m"] | None,
) -> list[Layer]:
    """The rows of a scene outside the region, inside it, and inside it tinted."""
    if region is None or len(region) != len(scene):
        return [Layer(name, splats_of(scene[rows]), shown)]
    inside = splats_of(scene[rows & region])
    tint = np.array(TINT, dtype=np.float32)
    colors = (1 - TINT_STRENGTH) * inside.colors + TINT_STRENGTH * tint
    tinted = Splats(inside.means, inside.covariances, colors.astype(np.float32), inside.opacities)
    return [
        Layer(f"{name}_outside", splats_of(scene[rows & ~region]), shown),
        Layer(f"{name}_inside", inside, shown, tinted=False),
        Layer(f"{name}_tinted", tinted, shown, tinted=True),
    ]


def shown_layers(layers: Sequence[Layer], scene: str, tinted: bool) -> list[str]:
    """The names of the layers that are visible in one state of the page."""
    return [layer.name for layer in layers if layer.is_shown(scene, tinted)]
