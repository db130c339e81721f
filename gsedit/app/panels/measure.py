"""Measuring between clicks, and setting the scale by a length that one knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsedit.errors import UsageError
from gsedit.mesh.sizes import SurfacePoint, area, distance, point_at

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Pick, Tab

NAME = "measure"
_HOW = "Click on two points for their distance, on more for the area between them."


class Measure:
    """The controls of one tab's measuring."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls; clicks select until the switch is on."""
        self.page, self.tab, gui, safely = page, tab, tab.gui, tab.safely
        self.points: list[SurfacePoint] = []
        self.on = gui.add_checkbox("clicks measure", False, hint=_HOW)
        self.told = gui.add_markdown(_HOW, visible=False)
        self.known = gui.add_number("known length", 0.0, min=0.0, step=0.001, visible=False)
        self.scale = gui.add_button("Set the scale by it", icon="ruler-2", visible=False)
        self.on.on_update(safely(lambda _: self.switch()))
        self.scale.on_click(safely(lambda _: self.rescale()))
        page.listen(tab, "scene", self.forget)

    def switch(self) -> None:
        """Let clicks measure, or select again."""
        self.told.visible = self.on.value
        if self.on.value:
            self.tab.begin()
            self.tab.pointer(NAME, self.clicked)
        else:
            self.tab.pointer(None)
            self.tab.give_back()
        self.forget()

    def forget(self) -> None:
        """Begin with another point."""
        self.points = []
        self.show()

    def clicked(self, pick: Pick) -> None:
        """Measure to one more point of the surface."""
        loaded = self.page.loaded

        def find() -> SurfacePoint:
            others = [each.camera for each in loaded.viewpoints]
            return point_at(loaded.scene, pick.camera, pick.x, pick.y, others)

        self.told.content = "Looking for the point…"
        self.tab.soon(NAME, find, self.take)

    def take(self, point: SurfacePoint) -> None:
        """Keep a point, and show what the points measure."""
        self.points.append(point)
        self.show()

    def show(self) -> None:
        """Tell the distance or the area of the points."""
        points = self.points
        if len(points) == 2:
            text = f"**{distance(*points)}**"
        elif len(points) > 2:
            text = f"**{area(points)}** ({len(points)} corners)"
        else:
            text = _HOW if not points else "1 point; click on the next."
        self.told.content = text
        self.known.visible = self.scale.visible = self.on.value and len(points) == 2

    def rescale(self) -> None:
        """Scale the scene so that the two points are the known length apart."""
        if not self.known.value:
            raise UsageError("write the known length first, in the unit that the scene shall have")
        ends = ",".join(f"{value:.9g}" for each in self.points for value in each.position)
        length = f"--length={ends}={self.known.value:.9g}"
        self.page.step("align", length, title=f"scale by {self.known.value:g}")


add = Measure
