"""Cropping: a box that is kept, and what is selected that is kept or deleted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from gsedit.app.steps import region_file
from gsedit.errors import UsageError
from gsedit.select.rules import inside_box

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


class Crop:
    """The controls of one tab's box."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls; the box is off."""
        self.page, self.tab, gui, safely = page, tab, tab.gui, tab.safely
        self.on = gui.add_checkbox("crop to a box", False, hint="What would go is colored.")
        self.folder = gui.add_folder("box", visible=False)
        with self.folder:
            self.ranges = [
                gui.add_multi_slider(axis, 0.0, 1.0, 1 / STEPS, (0.0, 1.0)) for axis in AXES
            ]
            around = gui.add_button("Around the selection", icon="box-margin")
            crop = gui.add_button("Crop", icon="crop")
        self.chosen = gui.add_button_group("selection", ("Keep only", "Delete"))
        self.on.on_update(safely(lambda _: self.show()))
        for each in self.ranges:
            each.on_update(safely(lambda _: self.show()))
        around.on_click(safely(lambda _: self.fit()))
        crop.on_click(safely(lambda _: self.cut()))
        self.chosen.on_click(safely(lambda _: self.act()))
        page.listen(tab, "scene", self.show)

    def box(self) -> tuple[Tensor, Tensor]:
        """The corners; infinite where a slider is at its end."""
        bulk = self.page.loaded.bulk
        center, size = torch.tensor(bulk.center), REACH * bulk.radius
        low, high = (torch.tensor([each.value[i] for each in self.ranges]) for i in (0, 1))
        below = torch.where(low <= 0, -torch.inf, center + (2 * low - 1) * size)
        return below, torch.where(high >= 1, torch.inf, center + (2 * high - 1) * size)

    def show(self) -> None:
        """Color what is outside."""
        if not self.on.value or not self.page.has_scene:
            if self.folder.visible:
                self.tab.tint(None)
            self.folder.visible = False
            return
        self.folder.visible = True
        scene, corners = self.page.scene, self.box()
        low, high = (each.tolist() for each in corners)
        outside = lambda: torch.from_numpy(~inside_box(scene.means.numpy(), low, high))  # noqa: E731
        self.tab.soon("crop", outside, self.tab.tint)

    def selected(self) -> Tensor:
        """The selection. Raises UsageError where nothing is selected."""
        if self.page.selection is None:
            raise UsageError("nothing is selected: click on an object, or say it")
        return self.page.selection

    def fit(self) -> None:
        """Put the box around the selection."""
        bulk, means = self.page.loaded.bulk, self.page.scene.means[self.selected()]
        center, size = torch.tensor(bulk.center), REACH * bulk.radius
        margin = MARGIN * bulk.radius
        corners = torch.stack((means.amin(0) - margin, means.amax(0) + margin))
        shares = (((corners - center) / size + 1) / 2).clamp(0, 1).T.tolist()
        for handle, (low, high) in zip(self.ranges, shares, strict=True):
            handle.value = (low, high)
        self.show()

    def cut(self) -> None:
        """Keep what is in the box; that is the next step."""
        corners = ",".join(f"{float(each):.9g}" for ends in self.box() for each in ends)
        self.page.step("filter", "--where", f"box({corners})", title="crop", after=self.end)

    def end(self) -> None:
        """Put the box away."""
        self.on.value = False

    def act(self) -> None:
        """Keep only the selection, or delete it; nothing is filled."""
        flags = self.selected()
        kept = flags if self.chosen.value == "Keep only" else ~flags
        title = f"{self.chosen.value.lower()} the selection"
        assert self.page.folder is not None  # something is selected
        file = region_file(kept, self.page.folder)
        self.page.step("filter", "--region", str(file), title=title)


add = Crop
