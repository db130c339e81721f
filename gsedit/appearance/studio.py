"""Where a scene is looked at from while it takes on a style, and the two steps of it.

`n` Gaussians; pictures of `h w` pixels, `m` of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.appearance.style_loss import StyleLoss, structure_kept
from gsedit.appearance.style_settings import StyleSettings
from gsedit.errors import UsageError
from gsedit.files.pictures import fitted_size
from gsedit.files.table import gaussians_of, table_of
from gsedit.fitting.crops import FEW, FEW_CELLS, ExactCrops, ListedCrops
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.points.color_maps import as_table
from gsedit.points.recolor import recolored
from gsedit.points.transport import color_transport, sliced_distance
from gsedit.views.coarse import coarsen
from gsedit.views.dataset import View
from gsedit.views.image_ops import downscale
from rasterizer.blending.choose import is_compiled
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

COLORS = 1 << 16
"""Of renders and of the picture, from which the map of colours is made."""
SLOWEST = 0.1
"""The learning rate falls linearly to this fraction."""


@dataclass(frozen=True)
class StyleMeasure:
    """Renders at views that nothing was fitted to."""

    stage: str
    """before, colours or texture."""
    color_distance: float
    """Sliced Wasserstein distance of the renders' colours from the picture's, in Lab."""
    structure: float
    """Correlation of the edges with those of the unedited renders, 1 at most."""
    seconds: float
    """Since the beginning."""

    def __str__(self) -> str:
        return (
            f"colours {self.color_distance:.1f} from the picture's (Lab), edges kept "
            f"{self.structure:.2f}"
        )


@dataclass(frozen=True, eq=False)
class Studio:
    """The picture, and where the scene is looked at from."""

    picture: Float[Tensor, "h w 3"]
    cameras: Sequence[Camera]
    held_out: Sequence[Camera]
    inside: Bool[Tensor, " n"] | None
    """What may change; None: everything."""
    settings: StyleSettings

    @torch.no_grad()
    def shots(self, scene: Gaussians, cameras: Sequence[Camera]) -> list[Float[Tensor, "h w 3"]]:
        """Renders, clamped to [0, 1]."""
        execution = self.settings.execution
        return [render(scene, c, execution=execution).color.clamp(0, 1) for c in cameras]

    @torch.no_grad()
    def coverage(self, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w"]:
        """The share of each pixel that comes from what may change."""
        drawn = render(scene, camera, marked=self.inside, execution=self.settings.execution)
        return (drawn.alpha if drawn.marked is None else drawn.marked).clamp(0, 1)

    @torch.no_grad()
    def backdrop(self, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        """The mean colour of the picture where nothing is: black would be an edge to paint."""
        alpha = render(scene, camera, execution=self.settings.execution).alpha.clamp(0, 1)
        return (1 - alpha)[..., None] * self.picture.mean((0, 1))

    def measure(
        self, stage: str, scene: Gaussians, unedited: Gaussians, seconds: float
    ) -> StyleMeasure:
        """Of renders at the held-out views, of what may change."""
        shots, before = (self.shots(each, self.held_out) for each in (scene, unedited))
        colors, weights = self._colors(scene, self.held_out, shots)
        distance = sliced_distance(colors, weights, _thinned(self.picture))
        return StyleMeasure(stage, distance, structure_kept(shots, before), seconds)

    def _colors(
        self,
        scene: Gaussians,
        cameras: Sequence[Camera],
        shots: Sequence[Float[Tensor, "h w 3"]],
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
        """Colours of renders, and how much of each pixel may change. Raises UsageError."""
        each = max(1, COLORS // len(cameras))
        colors, weights = [], []
        for camera, shot in zip(cameras, shots):
            stride = max(1, camera.width * camera.height // each)
            colors.append(shot.reshape(-1, 3)[::stride].double().numpy())
            weights.append(self.coverage(scene, camera).flatten()[::stride].double().numpy())
        weight = np.concatenate(weights)
        if not weight.any():
            raise UsageError("no view shows what is to change: give other views with --data")
        return np.concatenate(colors), weight

    def with_colors(self, scene: Gaussians, seed: int) -> Gaussians:
        """The scene with the colours of the picture: the map of the renders', of every Gaussian."""
        colors, weights = self._colors(scene, self.cameras, self.shots(scene, self.cameras))
        transport = color_transport(
            colors, weights, _thinned(self.picture), self.settings.strength, seed
        )
        table = table_of(scene)
        rows = np.ones(len(table), bool) if self.inside is None else self.inside.numpy()
        return replace(scene, sh=gaussians_of(recolored(table, rows, as_table(transport))).sh)

    def with_texture(
        self, scene: Gaussians, loss: StyleLoss, generator: torch.Generator
    ) -> Iterator[tuple[int, float] | Gaussians]:
        """Steps on random views: (step, loss) of each, and last the scene."""
        settings, coarse = self.settings, coarsen(scene)
        small = coarse.scene if coarse else scene
        moving = torch.ones(len(small), dtype=torch.bool)
        if self.inside is not None:
            moving = coarse.majority(self.inside) if coarse else self.inside
        before = self.shots(scene, self.cameras)
        behind = [self.backdrop(scene, camera) for camera in self.cameras]
        masks = [self.coverage(scene, camera) for camera in self.cameras]
        optimiser = SceneOptimiser(small, {"sh": settings.rate})
        optimiser.raise_negative_colours(moving)
        crops = self._crops(scene, small)
        views = [View(str(i), c, s) for i, (c, s) in enumerate(zip(self.cameras, before))]
        for step in range(settings.steps):
            i = int(torch.randint(len(views), (), generator=generator))
            view = views[i]
            box = (0, 0, view.camera.width, view.camera.height)
            (drawn,) = crops.draw(optimiser, [(view, box)])
            value = loss(drawn + behind[i], view.image + behind[i], masks[i])
            value.backward()
            optimiser.step(1 - (1 - SLOWEST) * step / settings.steps, only=moving)
            yield step + 1, value.item()
        edited = optimiser.scene.detach()
        styled = coarse.transfer(edited) if coarse else edited
        if self.inside is not None:  # cells mix what is inside with what is not
            sh = torch.where(self.inside[:, None, None], styled.sh, scene.sh)
            styled = replace(styled, sh=sh)
        yield styled

    def _crops(self, scene: Gaussians, small: Gaussians) -> ExactCrops:
        """Draws the scene that is fitted, of which only colours move."""
        execution = self.settings.execution
        if is_compiled(execution) and len(small) < (FEW if small is scene else FEW_CELLS):
            return ExactCrops(execution)
        if small is scene:
            return ListedCrops(scene, None, execution)
        return ListedCrops(
            small,
            lambda camera: render(scene, camera, execution=execution).color,
            execution,
            is_coarse=True,
        )


def sized(picture: Float[Tensor, "h w 3"], camera: Camera) -> Float[Tensor, "y x 3"]:
    """The picture, its longer side at most the views': a stroke then is as wide as on the wall."""
    height, width = picture.shape[:2]
    return downscale(picture, *fitted_size(width, height, max(camera.width, camera.height)))


def _thinned(picture: Float[Tensor, "h w 3"]) -> Float[np.ndarray, "m 3"]:
    """Evenly spaced pixels."""
    pixels = picture.reshape(-1, 3)
    return pixels[:: max(1, len(pixels) // COLORS)].double().numpy()
