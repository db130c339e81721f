"""Crops of views of the scene that is being fitted. `b` crops of `y x` pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.random_crops import cut
from gsedit.views.dataset import View
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.project import Box
from rasterizer.render import render
from rasterizer.scene import Gaussians

FELT = Numerics(gradient_min=1 / 1024)
"""Gaussians whose weight in a pixel is below 1/1024 get no gradient from it: all of them together
are 0.1 to 0.2 % of the bear's pictures, and half of what the backward pass would visit."""

Picture = Callable[[Camera], Float[Tensor, "h w 3"]]


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
        drawn = (
            render(scene, view.camera, crop=box, numerics=FELT, execution=self.execution)
            for view, box in patches
        )
        return torch.stack([each.color for each in drawn])


class CorrectedCrops(ExactCrops):
    """Crops of a merged scene of which only colors and opacities move, each with what the merged
    scene lacks there of the picture of the larger scene that it stands for."""

    is_coarse = True

    def __init__(self, start: Gaussians, unedited: Picture, execution: Execution = AUTO) -> None:
        """`start` has the optimizer's rows, before any moved; `unedited` draws the picture of a
        camera of the larger scene before the edit."""
        super().__init__(execution)
        self._start, self._unedited = start, unedited
        self._lacks: dict[str, Float[Tensor, "h w 3"]] = {}
        self._met: dict[str, Float[Tensor, "h w 3"]] = {}

    def draw(
        self, optimizer: SceneOptimizer, patches: Sequence[tuple[View, Box]]
    ) -> Float[Tensor, "b y x 3"]:
        """The patches as the larger scene would look; their gradients reach the next step."""
        lacks = [cut(self._lack(view), box) for view, box in patches]
        return super().draw(optimizer, patches) + torch.stack(lacks)

    def meet(self, view: View, picture: Float[Tensor, "h w 3"], optimizer: SceneOptimizer) -> None:
        """Calibrate a view: the optimizer's scene as it is now looks like this picture there."""
        lack = picture - self._whole(optimizer.scene.detach(), view.camera)
        self._lacks[_key(view)] = self._met[_key(view)] = lack

    def state(self) -> dict[str, Tensor]:
        """Corrections of the views that were calibrated (see `meet`); others can be computed
        again."""
        return dict(self._met)

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Continue from a `state`, before anything was drawn. Raises ValueError for no state."""
        for name in state:
            _, width, height = name.rsplit("|", 2)
            if tuple(state[name].shape) != (int(height), int(width), 3):
                raise ValueError(f"the state has no picture of the size of {name}")
        self._met, self._lacks = dict(state), dict(state)

    def _lack(self, view: View) -> Float[Tensor, "h w 3"]:
        key, camera = _key(view), view.camera
        if key not in self._lacks:
            self._lacks[key] = self._unedited(camera) - self._whole(self._start, camera)
        return self._lacks[key]

    @torch.no_grad()
    def _whole(self, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        return render(scene, camera, execution=self.execution).color


def _key(view: View) -> str:
    return f"{view.name}|{view.camera.width}|{view.camera.height}"


def color_crops(
    start: Gaussians, unedited: Picture, execution: Execution, *, is_coarse: bool
) -> ExactCrops:
    """Crops of a scene of which only colors and opacities move; of a merged one, corrected."""
    return CorrectedCrops(start, unedited, execution) if is_coarse else ExactCrops(execution)
