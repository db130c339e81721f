"""Moving, turning and scaling by handles in the view: the selection, or the whole scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from gsedit.scene.similarity import Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.toolkit.transform import center_of, compose, moved_rows
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

HANDLES = "/transform"
ARMS = 0.4
"""Length of the handles, as a share of the radius of the scene's bulk."""
FINEST, LARGEST = 0.1, 4.0
"""Range of the scale."""


class Transform:
    """The controls of one tab's move."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls; the handles are off."""
        self.page, self.tab, gui, safely = page, tab, tab.gui, tab.safely
        self.on = gui.add_checkbox("move and turn", False, hint=_HINT)
        self.scale = gui.add_slider("scale", FINEST, LARGEST, 0.01, 1.0, visible=False)
        self.apply = gui.add_button("Apply the move", icon="check", visible=False)
        self.handles: Any = None
        self.pivot = np.zeros(3)
        self.on.on_update(safely(lambda _: (self.on.value and tab.begin(), self.show())))
        tab.tools.append(self.end)
        self.scale.on_update(safely(lambda event: event.client is not None and self.moved()))
        self.apply.on_click(safely(lambda _: self.act()))
        for what in ("scene", "selection"):
            page.listen(tab, what, lambda: self.show() if self.on.value else None)

    def show(self) -> None:
        """Put the handles where the scene or the selection is, or take them away."""
        self.scale.visible = self.apply.visible = self.on.value
        if self.handles is not None:
            self.handles.remove()
            self.handles = None
            self.tab.drop("transform")
            self.tab.preview(None)
        page = self.page
        if not self.on.value or not page.has_scene:
            return
        means = page.scene.means if page.selection is None else page.scene.means[page.selection]
        self.pivot, self.scale.value = center_of(means.numpy()), 1.0
        arms = ARMS * page.loaded.bulk.radius
        add_handles = self.tab.client.scene.add_transform_controls
        self.handles = add_handles(HANDLES, arms, position=self.pivot)
        self.handles.on_update(self.tab.safely(lambda _: self.moved()))

    def steps(self) -> list[tuple[str, Any]]:
        """The turn, the scale and the shift about the pivot, as `compose` takes them."""
        shift = np.asarray(self.handles.position, float) - self.pivot
        turn = [float(each) for each in self.handles.wxyz]
        return [("quat", turn), ("scale", float(self.scale.value)), ("translate", shift.tolist())]

    def moved(self) -> None:
        """Show where the handles move it."""
        if self.handles is None:
            return
        scene, flags = self.page.scene, self.page.selection
        how = compose(self.steps()).about(self.pivot)
        self.tab.soon("transform", lambda: transformed(scene, flags, how), self.tab.preview)

    def act(self) -> None:
        """Move it; that is the next step."""
        if self.handles is None:
            return
        values = {k: v if k == "scale" else _listed(v) for k, v in self.steps()}
        options = [f"--{name}={value}" for name, value in values.items()]
        region = self.page.region_options()
        title = "move the selection" if region else "move the scene"
        options += [f"--pivot={_listed(self.pivot)}", *region]
        self.page.step("transform", *options, title=title, after=self.end)

    def end(self) -> None:
        """Put the handles away."""
        if self.on.value:
            self.on.value = False
            self.show()


_HINT = (
    "The selection, or the whole scene. What was behind stays open: a sentence, as “move it to "
    "the left”, fills it."
)


@torch.no_grad()
def transformed(scene: Gaussians, flags: torch.Tensor | None, how: Similarity) -> Gaussians:
    """The scene with the flagged Gaussians (None: all) moved; SH and covariances follow."""
    inside = np.ones(len(scene), bool) if flags is None else flags.numpy()
    return gaussians_of(moved_rows(table_of(scene), how, inside, copy=False))


def _listed(values: Any) -> str:
    return ",".join(f"{float(each):.9g}" for each in values)


add = Transform
