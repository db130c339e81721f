"""Cropping: a box that is kept, and what is selected that is kept or deleted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.regions.region import Region, save_region

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

AXES = ("x", "y", "z")
REACH = 2.0
"""Half of the length of the sliders, in radii of the scene's bulk; their ends keep all beyond."""
STEPS = 400
"""Steps of a slider."""
MARGIN = 0.02
"""Share of the bulk's radius that the box around a selection is larger."""


def inside_box(
    means: Float[Tensor, "n 3"], low: Float[Tensor, "3"], high: Float[Tensor, "3"]
) -> Bool[Tensor, " n"]:
    """Whether each center is in a box, its sides included."""
    return ((means >= low) & (means <= high)).all(1)


def add(page: Page, tab: Tab) -> None:
    """Add the box with its preview, and what is done with the selection."""
    gui = tab.gui
    on = gui.add_checkbox("crop to a box", False, hint="What would go is colored.")
    folder = gui.add_folder("box", visible=False)
    with folder:
        ranges = [gui.add_multi_slider(axis, 0.0, 1.0, 1 / STEPS, (0.0, 1.0)) for axis in AXES]
        around = gui.add_button("Around the selection", icon="box-margin")
        crop = gui.add_button("Crop", icon="crop")
    chosen = gui.add_button_group("selection", ("Keep only", "Delete"))

    def box() -> tuple[Tensor, Tensor]:
        """The corners; infinite where a slider is at its end."""
        bulk = page.loaded.bulk
        center, size = torch.tensor(bulk.center), REACH * bulk.radius
        low, high = (torch.tensor([r.value[i] for r in ranges]) for i in (0, 1))
        below = torch.where(low <= 0, -torch.inf, center + (2 * low - 1) * size)
        return below, torch.where(high >= 1, torch.inf, center + (2 * high - 1) * size)

    def show() -> None:
        folder.visible = on.value
        if not on.value or not page.has_scene:
            return tab.tint(None)
        scene, corners = page.scene, box()
        tab.soon("crop", lambda: ~inside_box(scene.means, *corners), tab.tint)

    def fit() -> None:
        if page.selection is None:
            raise UsageError("nothing is selected: click on an object, or say it")
        bulk, means = page.loaded.bulk, page.scene.means[page.selection]
        center, size = torch.tensor(bulk.center), REACH * bulk.radius
        margin = MARGIN * bulk.radius
        low, high = means.amin(0) - margin, means.amax(0) + margin
        for axis, handle in enumerate(ranges):
            ends = [(float(e[axis] - center[axis]) / size + 1) / 2 for e in (low, high)]
            handle.value = (max(min(ends[0], 1.0), 0.0), max(min(ends[1], 1.0), 0.0))
        show()

    def cut() -> None:
        corners = ",".join(f"{float(each):.9g}" for ends in box() for each in ends)
        page.step("filter", "--where", f"box({corners})", title="crop", after=lambda: done())

    def done() -> None:
        on.value = False

    def act() -> None:
        flags = page.selection
        if flags is None or page.folder is None:
            raise UsageError("nothing is selected: click on an object, or say it")
        kept = flags if chosen.value == "Keep only" else ~flags
        file = page.folder / "kept.npy"
        save_region(Region(kept, "kept"), file, overwrite=True)
        page.step("filter", "--region", str(file), title=f"{chosen.value.lower()} the selection")

    on.on_update(tab.safely(lambda _: show()))
    for each in ranges:
        each.on_update(tab.safely(lambda _: show() if on.value else None))
    around.on_click(tab.safely(lambda _: fit()))
    crop.on_click(tab.safely(lambda _: cut()))
    chosen.on_click(tab.safely(lambda _: act()))
    page.listen(tab, "scene", lambda: show() if on.value else None)
