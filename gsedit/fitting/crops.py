"""Crops of views of the scene that is being fitted, at about the cost of what they show.

While only colours and opacities move, what each pixel of a view shows is listed once
(`rasterizer.pixel_lists`), and a crop is blended from the lists. `b` crops of `y x` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import logsigmoid

from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.views.dataset import View
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.pixel_lists import PixelLists, blend, pixel_lists, shown_rows
from rasterizer.project import Box, view_dependent_colors
from rasterizer.render import render
from rasterizer.scene import Gaussians

LISTED_PIXELS = 400 * 400
"""Of a view, at most: lists take about 350 bytes a pixel, and are made for views that are cropped
often enough to be worth it."""

MOST_LISTED_PIXELS = 6_000_000
"""Of all views together: lists of 2 GB. A strategy may fit hundreds of views; steps that crop more
of them than that render."""

Picture = Callable[[Camera], Float[Tensor, "h w 3"]]


@dataclass(frozen=True, eq=False)
class _KeptView:
    lists: PixelLists
    missing: Float[Tensor, "h w 3"]
    """What the true picture before the edit has beyond that of the lists."""


class ExactCrops:
    """Crops that are rendered each time, whatever moves."""

    def __init__(self, execution: Execution = AUTO, *, depth: bool = False) -> None:
        """`depth` is drawn where it is asked for, and not used."""
        self.execution = execution
        self.depth = depth

    def draw(
        self, optimiser: SceneOptimiser, patches: Sequence[tuple[View, Box]]
    ) -> Float[Tensor, "b y x 3"]:
        """The patches of the optimiser's scene; their gradients reach its next step."""
        scene, execution = optimiser.scene, self.execution
        return torch.stack(
            [
                render(scene, v.camera, crop=box, depth=self.depth, execution=execution).color
                for v, box in patches
            ]
        )


class ListedCrops(ExactCrops):
    """Crops of a scene of which only colours and opacities move."""

    def __init__(
        self, start: Gaussians, unedited: Picture | None = None, execution: Execution = AUTO
    ) -> None:
        """`start` has the optimiser's rows, before any moved. `unedited` draws the picture of a
        camera that is to be met there; None: what `start` looks like.
        """
        super().__init__(execution)
        self.start = start
        self._unedited = unedited or self._render
        self._kept: dict[tuple[str, int, int], _KeptView] = {}
        self._log_opacities = logsigmoid(start.logit_opacities)
        self._places = torch.zeros(len(start), dtype=torch.int32)

    @torch.no_grad()
    def _render(self, camera: Camera) -> Float[Tensor, "h w 3"]:
        return render(self.start, camera, execution=self.execution).color

    def draw(
        self, optimiser: SceneOptimiser, patches: Sequence[tuple[View, Box]]
    ) -> Float[Tensor, "b y x 3"]:
        """The patches of the optimiser's scene; their gradients reach its next step."""
        if not self._fit([view for view, _ in patches]):
            return super().draw(optimiser, patches)
        kept = [self._keep(view) for view, _ in patches]
        crops = [each.lists.crop(box) for each, (_, box) in zip(kept, patches)]
        drawn = shown_rows(crops, len(self.start))
        scene = optimiser.draw(drawn)
        gains = (logsigmoid(scene.logit_opacities) - self._log_opacities[drawn]).exp()
        pictures = []
        for each, crop, (view, (left, top, width, height)) in zip(kept, crops, patches):
            self._places[drawn] = torch.arange(len(drawn), dtype=torch.int32)
            rows = shown_rows([crop], len(self.start))
            local = self._places[rows].long()
            colors = view_dependent_colors(scene.sh[local], scene.means[local], view.camera)
            self._places[rows] = torch.arange(len(rows), dtype=torch.int32)
            picture = blend(crop, self._places, colors, gains[local])
            missing = each.missing[top : top + height, left : left + width]
            pictures.append(picture + missing)
        return torch.stack(pictures)

    def _fit(self, views: Sequence[View]) -> bool:
        """Whether the lists of these views may be kept beside those that are."""
        sizes = {_key(view): view.camera.width * view.camera.height for view in views}
        more = sum(size for key, size in sizes.items() if key not in self._kept)
        kept = sum(width * height for _, width, height in self._kept)
        return max(sizes.values()) <= LISTED_PIXELS and kept + more <= MOST_LISTED_PIXELS

    @torch.no_grad()
    def _keep(self, view: View) -> _KeptView:
        camera = view.camera
        key = _key(view)
        if key not in self._kept:
            lists = pixel_lists(self.start, camera)
            shown = shown_rows([lists], len(self.start))
            self._places[shown] = torch.arange(len(shown), dtype=torch.int32)
            colors = view_dependent_colors(self.start.sh[shown], self.start.means[shown], camera)
            picture = blend(lists, self._places, colors, torch.ones(len(shown)))
            self._kept[key] = _KeptView(lists, self._unedited(camera) - picture)
        return self._kept[key]


def _key(view: View) -> tuple[str, int, int]:
    return view.name, view.camera.width, view.camera.height
