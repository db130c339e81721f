"""Opening: a path, or photos that become a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.app.opening import QUALITIES, is_photos, make_scene, open_path

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab


def add(page: Page, tab: Tab) -> None:
    """Add a field for a path, and what makes a scene of photos."""
    gui = tab.gui
    path = gui.add_text("path", "", hint="A scene, the folder of an edit, photos or a video.")
    opened = gui.add_button("Open", icon="folder-open")
    photos = gui.add_markdown("", visible=False)
    quality = gui.add_dropdown("quality", QUALITIES, initial_value="draft", visible=False)
    make = gui.add_button("Make a scene of the photos", icon="camera", visible=False)
    kept = gui.add_markdown("")

    def show() -> None:
        source = page.document.source
        waits = bool(source) and not page.document.steps and is_photos(Path(source))
        photos.visible = quality.visible = make.visible = waits
        if waits:
            photos.content = f"Photos: `{source}`"
        kept.content = f"Kept in `{page.folder}`" if page.folder else ""

    @opened.on_click
    @tab.safely
    def _(_) -> None:
        open_path(page, page.places.check(path.value))

    make.on_click(tab.safely(lambda _: make_scene(page, quality.value)))
    page.listen(tab, "document", show)
    show()
