"""Crops of views of the scene that is being fitted, at about the cost of what they show.

While only colors and opacities move, what each pixel of a view shows is listed once
(`rasterizer.pixel_lists`), and a crop is blended from the lists. `b` crops of `y x` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import logsigmoid

from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.views.dataset import View
from rasterizer.blending.choose import is_compiled
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.pixel_lists import MIN_LISTED_WEIGHT, PixelLists, blend, pixel_lists, shown_rows
from rasterizer.project import Box, view_dependent_colors
from rasterizer.render import render
from rasterizer.scene import Gaussians

LISTED_PIXELS = 400 * 400
"""Most pixels of a listed view: lists take about 350 bytes a pixel, and are made for views cropped
often enough to be worth it."""

MOST_LISTED_PIXELS = 6_000_000
"""Most pixels of all listed views: lists of 2 GB. A strategy may fit hundreds of views; steps that
crop more of them than that render."""

MIN_LISTED_GAUSSIANS = 300_000
"""Gaussians of a scene, below which the compiled kernel renders a crop in less time than torch
blends one from lists: CPU time of a step of four crops of 64 pixels is 20 ms for 44,000 Gaussians
(lists: 65 ms), 54 ms for 131,000 (100 ms), and 153 ms for 349,000 (150 ms)."""
MIN_LISTED_GROUPS = 60_000
"""Limit for the groups of a merged scene: lists also know what they lack."""

FELT = Numerics(gradient_min=MIN_LISTED_WEIGHT)
"""Gaussians that lists leave out of a pixel get no gradient from its render either."""

Picture = Callable[[Camera], Float[Tensor, "h w 3"]]


@dataclass(frozen=True, eq=False)
class _KeptView:
    lists: PixelLists | None
    """None: it is large, and its crops are rendered."""
    missing: Float[Tensor, "h w 3"] | None
    """Difference of the true picture to that of the lists, or of the merged scene; None: none."""


class ExactCrops:
    """Crops that are rendered each time, whatever moves."""

    is_coarse = False
    """Whether they are of a merged scene."""

    def __init__(self, execution: Execution = AUTO) -> None:
        self.execution = execution

    def draw(
        self, optimizer: SceneOptimizer, patches: Sequence[tuple[View, Box]]
    ) -> Float[Tensor, "b y x 3"]:
        """The patches of the optimizer's scene; their gradients reach its next step."""
        scene = optimizer.scene
        return torch.stack([self._rendered(scene, view.camera, box) for view, box in patches])

    def _rendered(self, scene: Gaussians, camera: Camera, box: Box) -> Float[Tensor, "y x 3"]:
        execution = self.execution
        return render(
            scene, camera, crop=box, depth=False, numerics=FELT, execution=execution
        ).color


class ListedCrops(ExactCrops):
    """Crops of a scene of which only colors and opacities move."""

    def __init__(
        self,
        start: Gaussians,
        unedited: Picture | None = None,
        execution: Execution = AUTO,
        *,
        is_coarse: bool = False,
        most_listed_pixels: int = MOST_LISTED_PIXELS,
    ) -> None:
        """`start` has the optimizer's rows, before any moved. `unedited` draws the picture of a
        camera before the edit (None: `start` is rendered); `is_coarse`: it shows a larger scene,
        for which `start` stands.
        """
        super().__init__(execution)
        self.start, self.is_coarse = start, is_coarse
        self._most_listed_pixels = most_listed_pixels
        self._unedited = unedited or self._render
        self._kept: dict[tuple[str, int, int], _KeptView] = {}
        self._met: dict[str, Tensor] = {}
        self._log_opacities = logsigmoid(start.logit_opacities)
        self._places = torch.zeros(len(start), dtype=torch.int32)

    @torch.no_grad()
    def _render(self, camera: Camera) -> Float[Tensor, "h w 3"]:
        return render(self.start, camera, execution=self.execution).color

    def draw(
        self, optimizer: SceneOptimizer, patches: Sequence[tuple[View, Box]]
    ) -> Float[Tensor, "b y x 3"]:
        """The patches of the optimizer's scene; their gradients reach its next step."""
        kept = [self._keep(view) for view, _ in patches]
        crops = [each.lists and each.lists.crop(box) for each, (_, box) in zip(kept, patches)]
        listed = [crop for crop in crops if crop is not None]
        if len(listed) == len(crops):
            drawn = shown_rows(listed, len(self.start))
            scene = optimizer.draw(drawn)
        else:
            drawn, scene = torch.arange(len(self.start)), optimizer.scene
        pictures = []
        for each, crop, (view, box) in zip(kept, crops, patches):
            if crop is None:
                drawing = self._rendered(scene, view.camera, box)
            else:
                drawing = self._blend(scene, drawn, crop, view.camera)
            left, top, width, height = box
            if each.missing is not None:
                drawing = drawing + each.missing[top : top + height, left : left + width]
            pictures.append(drawing)
        return torch.stack(pictures)

    def _blend(
        self,
        scene: Gaussians,
        drawn: Int[Tensor, " m"],
        crop: PixelLists,
        camera: Camera,
    ) -> Float[Tensor, "y x 3"]:
        """The picture of the lists; `scene` has the rows `drawn` of the optimizer's."""
        self._places[drawn] = torch.arange(len(drawn), dtype=torch.int32)
        rows = shown_rows([crop], len(self.start))
        local = self._places[rows].long()
        shown = (scene.sh, scene.means, scene.logit_opacities)
        sh, means, logits = (field.index_select(0, local) for field in shown)
        gains = (logsigmoid(logits) - self._log_opacities[rows]).exp()
        self._places[rows] = torch.arange(len(rows), dtype=torch.int32)
        return blend(crop, self._places, view_dependent_colors(sh, means, camera), gains)

    def _fits(self, pixels: int) -> bool:
        """Whether the lists of a view of so many pixels may be kept beside those that are."""
        kept = sum(w * h for (_, w, h), each in self._kept.items() if each.lists)
        return pixels <= LISTED_PIXELS and kept + pixels <= self._most_listed_pixels

    def _keep(self, view: View) -> _KeptView:
        camera, key = view.camera, _key(view)
        if key not in self._kept:
            is_listed = self._fits(camera.width * camera.height)
            lists = pixel_lists(self.start, camera) if is_listed else None
            self._kept[key] = _KeptView(lists, None)
            if (met := self._met.get("|".join(map(str, key)))) is not None:
                self._kept[key] = _KeptView(lists, met)
            elif is_listed or self.is_coarse:
                self._meet(view, self._unedited(camera), self.start)
        return self._kept[key]

    def meet(self, view: View, picture: Float[Tensor, "h w 3"], optimizer: SceneOptimizer) -> None:
        """Calibrate a view: the optimizer's scene as it is now looks like this picture there."""
        self._keep(view)
        self._meet(view, picture, optimizer.scene.detach())
        if (missing := self._kept[_key(view)].missing) is not None:
            self._met["|".join(map(str, _key(view)))] = missing

    def state(self) -> dict[str, Tensor]:
        """Pictures that calibrate views (see `meet`), by view; the rest here can be computed
        again."""
        return dict(self._met)

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Continue from a `state`, before anything was drawn. Raises ValueError for no state."""
        for name in state:
            _, width, height = name.rsplit("|", 2)
            if tuple(state[name].shape) != (int(height), int(width), 3):
                raise ValueError(f"the state has no picture of the size of {name}")
        self._met = dict(state)

    @torch.no_grad()
    def _meet(self, view: View, picture: Float[Tensor, "h w 3"], scene: Gaussians) -> None:
        camera, key = view.camera, _key(view)
        lists = self._kept[key].lists
        if lists is None:
            drawn = render(scene, camera, execution=self.execution).color
        else:
            rows = shown_rows([lists], len(scene))
            drawn = self._blend(scene[rows], rows, lists, camera)
        self._kept[key] = _KeptView(lists, picture - drawn)


def _key(view: View) -> tuple[str, int, int]:
    return view.name, view.camera.width, view.camera.height


def color_crops(
    start: Gaussians, unedited: Picture | None, execution: Execution, *, is_coarse: bool
) -> ExactCrops:
    """Crops of a scene of which only colors and opacities move, from lists or rendered, whichever
    is faster; the arguments are those of `ListedCrops`."""
    few = len(start) < (MIN_LISTED_GROUPS if is_coarse else MIN_LISTED_GAUSSIANS)
    if few and is_compiled(execution):
        return ExactCrops(execution)
    return ListedCrops(start, unedited, execution, is_coarse=is_coarse)
