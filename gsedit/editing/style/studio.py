"""The two steps that give a scene a style, colors and texture, and the views they render.

`n` Gaussians; pictures of `h w` pixels, `m` of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.capture.fitting.crops import color_crops
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.editing.style.settings import StyleSettings
from gsedit.errors import UsageError
from gsedit.formats.pictures import fitted_size
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.measures.losses import gram, mse
from gsedit.run.step_threads import StepThreads
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.merging import coarsen
from gsedit.scene.picture import render_picture
from gsedit.scene.table import gaussians_of, table_of
from gsedit.select.region import Region, coverage
from gsedit.toolkit.grade import as_table
from gsedit.toolkit.recolor import color_transport, recolored, sliced_distance
from gsedit.views.dataset import View
from gsedit.views.image_ops import downscale
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

CONTENT_OCTAVES = slice(1, None)
"""Octaves of the filter bank in which content is kept: strokes may be drawn in the finest."""


class StyleLoss:
    """How far pictures are from the style of one, and from their own content."""

    def __init__(
        self, picture: Float[Tensor, "h w 3"], features: FeatureExtractor, content: float
    ) -> None:
        """`picture` in [0, 1] has the style; `content` is the weight of what is kept."""
        self.features, self.content, self.bank = features, content, FilterBank()
        with torch.no_grad():
            self.target = [gram(layer) for layer in features(_channels_first(picture))]

    def __call__(
        self,
        drawn: Float[Tensor, "h w 3"],
        before: Float[Tensor, "h w 3"],
        mask: Float[Tensor, "h w"],
    ) -> Float[Tensor, ""]:
        """The loss of a rendered picture, unedited `before`; only style inside `mask` counts.

        Style: squared differences of Gram matrices (Gatys et al. 2016) relative to the square of
        the picture's own, summed over layers. Content: MSE of the octaves of a filter bank.
        """
        now = _channels_first(drawn)
        grams = [gram(_masked(layer, mask)) for layer in self.features(now)]
        style = [
            (ours - goal).square().sum() / goal.square().sum()
            for ours, goal in zip(grams, self.target, strict=True)
        ]
        old = self.bank(_channels_first(before))[CONTENT_OCTAVES]
        new = self.bank(now)[CONTENT_OCTAVES]
        kept = [mse(a, b) for a, b in zip(new, old, strict=True)]
        return torch.stack(style).sum() + self.content * torch.stack(kept).sum()


def _channels_first(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "1 3 h w"]:
    return picture.movedim(-1, 0)[None]


def _masked(
    layer: Float[Tensor, "n c y x"], mask: Float[Tensor, "h w"]
) -> Float[Tensor, "n c y x"]:
    """The layer scaled so that its Gram matrix is the mean over the mask."""
    height, width = layer.shape[-2:]
    small = F.adaptive_avg_pool2d(mask[None, None], (height, width))
    return layer * (small / small.mean().clamp_min(1e-6)).sqrt()


@torch.no_grad()
def edges(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "y x"]:
    """Strength of the edges of luma (Sobel), of pixels two by two."""
    luma = picture @ torch.tensor(LUMINANCE, dtype=picture.dtype)
    slope = torch.tensor([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
    kernels = torch.stack((slope, slope.T))[:, None].to(luma)
    return F.conv2d(F.avg_pool2d(luma[None, None], 2), kernels)[0].norm(dim=0)


def structure_kept(
    pictures: Sequence[Float[Tensor, "h w 3"]], originals: Sequence[Float[Tensor, "h w 3"]]
) -> float:
    """Correlation of the edges of pictures with those of the originals, the mean over pictures: 1
    where no edge came or went, about 0 for unrelated pictures."""
    pairs = zip(pictures, originals, strict=True)
    each = [
        torch.corrcoef(torch.stack((edges(a).flatten(), edges(b).flatten())))[0, 1]
        for a, b in pairs
    ]
    return float(torch.stack(each).nan_to_num(0).mean())


MAX_COLORS = 1 << 16
"""Most colors of the renders, and of the picture, that the map of colors is made from."""
FINAL_RATE_SHARE = 0.1
"""Share of the learning rate to which it falls linearly."""


@dataclass(frozen=True)
class StyleMeasure:
    """Renders at views that nothing was fitted to."""

    stage: str
    """before, colors or texture."""
    color_distance: float
    """Sliced Wasserstein distance of the renders' colors from the picture's, in Lab."""
    structure: float
    """Correlation of the edges with those of the unedited renders, 1 at most."""
    seconds: float
    """Seconds since the beginning."""

    def __str__(self) -> str:
        return (
            f"colors {self.color_distance:.1f} from the picture's (Lab), edges kept "
            f"{self.structure:.2f}"
        )


@dataclass(frozen=True, eq=False)
class Studio:
    """The picture, and where the scene is looked at from."""

    picture: Float[Tensor, "h w 3"]
    cameras: Sequence[Camera]
    held_out: Sequence[Camera]
    inside: Bool[Tensor, " n"] | None
    """The Gaussians that may change; None for all."""
    settings: StyleSettings

    def shots(self, scene: Gaussians, cameras: Sequence[Camera]) -> list[Float[Tensor, "h w 3"]]:
        """Renders, clamped to [0, 1]."""
        return [render_picture(scene, camera, self.settings.execution) for camera in cameras]

    @torch.no_grad()
    def coverage(self, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w"]:
        """The share of each pixel that comes from what may change."""
        execution = self.settings.execution
        if self.inside is None or self.inside.all():
            return render(scene, camera, execution=execution).alpha.clamp(0, 1)
        return coverage(Region(self.inside), scene, camera, execution).clamp(0, 1)

    @torch.no_grad()
    def backdrop(self, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        """The mean color of the picture where nothing is: black would be an edge to paint."""
        alpha = render(scene, camera, execution=self.settings.execution).alpha.clamp(0, 1)
        return (1 - alpha)[..., None] * self.picture.mean((0, 1))

    def measure(
        self, stage: str, scene: Gaussians, unedited: Gaussians, seconds: float
    ) -> StyleMeasure:
        """Measure renders at the held-out views, of what may change."""
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
        """Colors of renders, and how much of each pixel may change. Raises UsageError."""
        each = max(1, MAX_COLORS // len(cameras))
        colors, weights = [], []
        for camera, shot in zip(cameras, shots):
            stride = max(1, camera.width * camera.height // each)
            colors.append(shot.reshape(-1, 3)[::stride].double().numpy())
            weights.append(self.coverage(scene, camera).flatten()[::stride].double().numpy())
        weight = np.concatenate(weights)
        if not weight.any():
            raise UsageError("no view shows what is to change: give other views with --data")
        return np.concatenate(colors), weight

    def with_colors(self, scene: Gaussians) -> Gaussians:
        """The scene with the colors of the picture: the map of the renders', of every Gaussian."""
        colors, weights = self._colors(scene, self.cameras, self.shots(scene, self.cameras))
        transport = color_transport(colors, weights, _thinned(self.picture), self.settings.strength)
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
        optimizer = SceneOptimizer(small, {"sh": settings.rate})
        optimizer.raise_negative_colors(moving)
        execution, threads = settings.execution, StepThreads()
        whole = lambda camera: render(scene, camera, execution=execution).color  # noqa: E731
        crops = color_crops(small, whole, execution, is_coarse=coarse is not None)
        views = [View(str(i), c, s) for i, (c, s) in enumerate(zip(self.cameras, before))]
        for step in range(settings.steps):
            i = int(torch.randint(len(views), (), generator=generator))
            view = views[i]
            box = (0, 0, view.camera.width, view.camera.height)
            with threads.step():
                (drawn,) = crops.draw(optimizer, [(view, box)])
                value = loss(drawn + behind[i], view.image + behind[i], masks[i])
                value.backward()
                optimizer.step(1 - (1 - FINAL_RATE_SHARE) * step / settings.steps, only=moving)
            yield step + 1, value.item()
        edited = optimizer.scene.detach()
        styled = coarse.transfer(edited) if coarse else edited
        if self.inside is not None:  # groups mix what is inside with what is not
            sh = torch.where(self.inside[:, None, None], styled.sh, scene.sh)
            styled = replace(styled, sh=sh)
        yield styled


def sized(picture: Float[Tensor, "h w 3"], camera: Camera) -> Float[Tensor, "y x 3"]:
    """The picture, its longer side at most the views': a stroke then is as wide as on the wall."""
    height, width = picture.shape[:2]
    return downscale(picture, *fitted_size(width, height, max(camera.width, camera.height)))


def _thinned(picture: Float[Tensor, "h w 3"]) -> Float[np.ndarray, "m 3"]:
    """At most MAX_COLORS evenly spaced pixels."""
    pixels = picture.reshape(-1, 3)
    return pixels[:: max(1, len(pixels) // MAX_COLORS)].double().numpy()
