"""Moving, turning and scaling by handles in the view: the selection, or the whole scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from gsedit.scene.similarity import Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.toolkit.steps import compose
from gsedit.toolkit.transform import center_of, moved_rows
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

HANDLES = "/transform"
ARMS = 0.4
"""Length of the handles, as a share of the radius of the scene's bulk."""
FINEST, LARGEST = 0.1, 4.0
"""Range of the scale."""


def add(page: Page, tab: Tab) -> None:
    """Add the switch for the handles, the scale, and Apply."""
    gui, scene = tab.gui, tab.client.scene
    on = gui.add_checkbox("move and turn", False, hint="The selection, or the whole scene.")
    scale = gui.add_slider("scale", FINEST, LARGEST, 0.01, 1.0, visible=False)
    apply = gui.add_button("Apply the move", icon="check", visible=False)
    held: list[Any] = []
    pivot: list[np.ndarray] = []

    def show() -> None:
        scale.visible = apply.visible = on.value
        for handle in held:
            handle.remove()
        held.clear()
        if not on.value or not page.has_scene:
            return tab.preview(None)
        means = page.scene.means if page.selection is None else page.scene.means[page.selection]
        pivot[:] = [center_of(means.numpy())]
        scale.value = 1.0
        arms = ARMS * page.loaded.bulk.radius
        held.append(scene.add_transform_controls(HANDLES, arms, position=pivot[0]))
        held[0].on_update(tab.safely(lambda _: moved()))

    def similarity() -> Similarity:
        return compose(steps()).about(pivot[0])

    def steps() -> list[tuple[str, Any]]:
        shift = np.asarray(held[0].position, float) - pivot[0]
        turn = [float(each) for each in held[0].wxyz]
        return [("quat", turn), ("scale", float(scale.value)), ("translate", shift.tolist())]

    def moved() -> None:
        if not held:
            return
        now, flags, how = page.scene, page.selection, similarity()
        tab.soon("transform", lambda: transformed(now, flags, how), tab.preview)

    def act() -> None:
        texts = {name: value if name == "scale" else _listed(value) for name, value in steps()}
        options = [f"--{name}={text}" for name, text in texts.items()]
        file = page.selection_file()
        region = () if file is None else ("--region", str(file))
        title = "move the scene" if file is None else "move the selection"
        page.step("transform", *options, f"--pivot={_listed(pivot[0])}", *region, title=title)
        on.value = False
        show()

    def changed() -> None:
        """Put the handles where the new scene or selection is."""
        if on.value:
            show()

    on.on_update(tab.safely(lambda _: show()))
    scale.on_update(tab.safely(lambda event: moved() if event.client is not None else None))
    apply.on_click(tab.safely(lambda _: act()))
    for what in ("scene", "selection"):
        page.listen(tab, what, changed)


@torch.no_grad()
def transformed(scene: Gaussians, flags: torch.Tensor | None, how: Similarity) -> Gaussians:
    """The scene with the flagged Gaussians (None: all) moved; SH and covariances follow."""
    inside = np.ones(len(scene), bool) if flags is None else flags.numpy()
    return gaussians_of(moved_rows(table_of(scene), how, inside, copy=False))


def _listed(values: Any) -> str:
    return ",".join(f"{float(each):.9g}" for each in values)
