"""Opening: by a path, and where it is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsedit.app.opening import open_path

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab


def add(page: Page, tab: Tab) -> None:
    """Add a field for a path."""
    gui = tab.gui
    path = gui.add_text("path", "", hint="A scene, the folder of an edit, photos or a video.")
    opened = gui.add_button("Open", icon="folder-open")
    kept = gui.add_markdown("")

    def show() -> None:
        kept.content = f"Kept in `{page.folder}`" if page.folder else ""

    opened.on_click(tab.safely(lambda _: open_path(page, page.places.check(path.value))))
    page.listen(tab, "document", show)
    show()
