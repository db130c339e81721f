"""Painting styles: each on the current view, and one to say."""

from __future__ import annotations

from typing import Any

from gsedit.scene.picture import render_picture
from gsedit.words.lexicon import styles

THUMBNAIL = 128
"""Longer side of a picture of a style, pixels."""
COLUMNS = 3
"""Pictures beside each other: the panel is about 300 pixels wide."""
NONE = "choose a style"


class Styles:
    """The styles below one tab's sentence."""

    def __init__(self, say: Any) -> None:
        """Add the controls of a `Say`, folded up."""
        self.say, tab = say, say.tab
        with tab.gui.add_folder("painting styles", expand_by_default=False):
            self.names = tab.gui.add_dropdown("style", (NONE, *styles()))
            self.show = tab.gui.add_button("Show all on this view", icon="palette")
            self.sheet: Any = None
            self.place = tab.gui.add_folder("on this view", visible=False)
        self.names.on_update(tab.safely(self.chosen))
        self.show.on_click(tab.safely(lambda _: self.paint()))

    def chosen(self, event: Any) -> None:
        """Say the style that a person has chosen, and preview it."""
        if event.client is None or self.names.value == NONE:
            return
        whole = "" if self.say.page.selection is None else "it "
        self.say.text.value = f"{whole}in the style of {self.names.value}"
        self.say.typed()
        self.say.preview()

    def paint(self) -> None:
        """Show the current view in every style."""
        say, page = self.say, self.say.page
        if not page.has_scene:
            return
        camera = say.tab.camera().fitted(THUMBNAIL)

        def work() -> Any:
            import numpy as np

            from gsedit.formats.pictures import as_picture
            from gsedit.paper.editors.painter.style_sheet import in_every_style
            from gsedit.pictures.captioned import captioned

            cells = in_every_style(render_picture(page.scene, camera))
            named = [(name, as_picture(picture)) for name, picture in cells]
            return np.asarray(captioned(named, COLUMNS))

        say.waits.visible = True
        say.tab.soon("styles", say.waited(work), self.shown)

    def shown(self, picture: Any) -> None:
        """Show the sheet in the place of an earlier one."""
        if self.sheet is not None:
            self.sheet.remove()
        with self.place:
            self.sheet = self.say.tab.gui.add_image(picture, format="jpeg")
        self.place.visible = True
