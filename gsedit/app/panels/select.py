"""Selecting: by click and by box; larger, smaller, the others; saved by a name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import monotonic
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.app.steps import region_file
from gsedit.errors import UsageError
from gsedit.scene.table import table_of
from gsedit.select.click import Click, Selector, at_one_place
from gsedit.select.kinds import grow, shrink
from gsedit.select.region import Region
from gsedit.select.saved import save_named, saved_files
from gsedit.select.selection import given
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Box, Pick, Tab


@dataclass(frozen=True)
class Clicks:
    """The clicks of one selection, in order, and what was selected before them."""

    clicks: tuple[Click, ...] = ()

    def with_click(self, click: Click, *, add: bool) -> Clicks:
        """With one more click; a plain one begins anew, but at the same place takes the part there.
        Raises UsageError for a first one outside."""
        if not add:
            again = self.clicks and all(at_one_place(click, each) for each in self.clicks)
            return replace(self, clicks=(*self.clicks, click)) if again else Clicks((click,))
        if not self.clicks and not click.inside:
            raise UsageError("click on the object first; then take parts away")
        return replace(self, clicks=(*self.clicks, click))

    def selected(self, selector: Selector) -> tuple[Clicks, Region]:
        """The region of the clicks; where there is no smaller part, the whole object again, as with
        the last click alone. Raises UsageError as `Selector.at` does."""
        region = selector.at(self.clicks)
        if not region.is_least:
            return self, region
        whole = Clicks(self.clicks[-1:])
        return whole, selector.at(whole.clicks)


def grown(scene: Gaussians, flags: Bool[Tensor, " n"], radius: float) -> Bool[Tensor, " n"]:
    """The selection and all within a radius of it, world units; shrunk by a negative one."""
    inside = given(flags.numpy())
    selection = grow(inside, radius) if radius > 0 else shrink(inside, -radius)
    return torch.from_numpy(selection.mask(table_of(scene)))


NAME = "select"
ADD, TAKE = "cmd/ctrl", "alt"
"""Keys held at a click: select this too; take this away."""
SELECTS, ADDS, TAKES, NOTHING = "select", "add", "take away", "do nothing"
"""Ways of a click without a key, as on a phone."""
SELECT, KEEP = "selection", "Keep only"
DOUBLE = 0.4
"""Seconds within which a second click frames what the first selected."""


class Select:
    """The controls of one tab's selection."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls, and let clicks select."""
        self.page, self.tab, gui = page, tab, tab.gui
        self.clicks, self.clicked_at = Clicks(), -DOUBLE
        self.state = gui.add_markdown("")
        self.picks = gui.add_dropdown("clicks", (SELECTS, ADDS, TAKES, NOTHING), hint=_HOW)
        self.change = gui.add_button_group("", ("Grow", "Shrink", "Invert", "None"))
        self.cut = gui.add_button_group("", (KEEP, "Delete"))
        self.name = gui.add_text("name", "", hint="Sentences may say it: “paint the chair gold”.")
        self.save = gui.add_button("Save the selection", icon="tag")
        safely = tab.safely
        self.picks.on_update(safely(lambda _: self.point()))
        self.change.on_click(safely(lambda _: self.changed(self.change.value)))
        self.cut.on_click(safely(lambda _: self.filter(self.cut.value)))
        self.save.on_click(safely(lambda _: self.keep()))
        tab.key("Select nothing", "escape", lambda: page.select(None))
        tab.key("Invert the selection", "I", lambda: self.changed("Invert"), "cmd/ctrl")
        for what in ("scene", "selection"):
            page.listen(tab, what, self.show)
        page.listen(tab, "scene", self.forget)
        tab.give_back = self.point
        self.point()
        self.show()

    def show(self) -> None:
        """Tell what is selected, and the saved names."""
        page = self.page
        count = 0 if page.selection is None else int(page.selection.sum())
        note = page.note.partition(" at this view")[0]
        self.state.content = f"{count:,} Gaussians: {note}" if count else _HOW
        names = saved_files(page.scene_file) if page.has_scene else ()
        self.state.content += f"\n\nSaved: {', '.join(names)}" if names else ""

    def forget(self) -> None:
        """Begin with other clicks: the scene is another."""
        self.clicks = Clicks()

    def point(self) -> None:
        """Let clicks and boxes select, or not."""
        if self.picks.value != NOTHING:
            self.tab.pointer(NAME, self.clicked, self.boxed, (None, ADD, TAKE))
        elif self.tab.pointer_name == NAME:
            self.tab.pointer(None)

    def clicked(self, pick: Pick) -> None:
        """Select the object at a click, add it, or take away what is under it."""
        again = monotonic() - self.clicked_at < DOUBLE
        self.clicked_at = monotonic()
        if again and pick.modifier is None:
            return self.tab.soon("frame", lambda: None, lambda _: self.tab.frame())
        held = pick.modifier or {ADDS: ADD, TAKES: TAKE}.get(self.picks.value)
        click = Click(pick.camera, pick.x, pick.y, held != TAKE, "this view")
        clicks = self.clicks.with_click(click, add=held is not None)
        loaded = self.page.loaded
        if not loaded.is_ready:
            self.tab.tell("still looking for the objects of the scene: about 10 s, once")

        def then(found: tuple[Clicks, Region]) -> None:
            self.tab.hush()
            self.clicks, region = found
            self.take(region)

        self.tab.soon(SELECT, lambda: clicks.selected(loaded.ready().selector), then)

    def boxed(self, box: Box) -> None:
        """Select the objects in a box."""
        loaded, corners = self.page.loaded, (box.x0, box.y0, box.x1, box.y1)
        self.tab.soon(SELECT, lambda: loaded.ready().selector.box(box.camera, *corners), self.take)

    def take(self, region: Region) -> None:
        """Make a region the selection."""
        self.page.select(region.inside, region.note)

    def changed(self, how: str) -> None:
        """Grow, shrink or invert the selection, or end it."""
        page = self.page
        if how == "None":
            self.clicks = Clicks()
            return page.select(None)
        flags = self.selected()
        if how == "Invert":
            return page.select(~flags, f"all but {page.note}")
        radius = 0.01 * page.loaded.bulk.radius * (1 if how == "Grow" else -1)
        scene, note = page.scene, page.note
        self.tab.soon(SELECT, lambda: grown(scene, flags, radius), lambda x: page.select(x, note))

    def selected(self) -> Tensor:
        """The selection. Raises UsageError where nothing is selected."""
        if self.page.selection is None:
            raise UsageError("nothing is selected: click on an object, or say it")
        return self.page.selection

    def filter(self, how: str) -> None:
        """Keep only the selection, or delete it; nothing is filled."""
        flags, folder = self.selected(), self.page.folder
        assert folder is not None  # something is selected
        file = region_file(flags if how == KEEP else ~flags, folder)
        self.page.step("filter", "--region", str(file), title=f"{how.lower()} the selection")

    def keep(self) -> None:
        """Save the selection beside the scene, in the place of one of the same name."""
        page, name = self.page, self.name.value.strip()
        flags, means = self.selected().numpy(), page.scene.means.numpy()
        save_named(flags, means, page.scene_file, name, overwrite=True)
        self.tab.tell(f"saved as “{name}”: sentences may say it")
        self.name.value = ""
        page.notify("selection")


_HOW = (
    "Click on an object; again at the same place, for the part there. Ctrl-click adds, Alt-click "
    "takes away, a drag with Shift draws a box. A double click, or F, frames it."
)


add = Select
