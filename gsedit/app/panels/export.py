"""Files: opening by a path; export in any format, as a page that shows it from disk, as a video."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from gsedit.app.opening import open_path
from gsedit.formats.pictures import save_picture
from gsedit.formats.registry import WRITABLE

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

PAGE, VIDEO, PICTURE = "page that opens from disk (.html)", "turntable (.mp4)", "this view (.png)"
VIDEO_PIXELS, VIDEO_FRAMES = 640, 120


def add(page: Page, tab: Tab) -> None:
    """Add a field for a path to open, and the export."""
    gui = tab.gui
    path = gui.add_text("path", "", hint="A scene, the folder of an edit, photos or a video.")
    opened = gui.add_button("Open", icon="folder-open")
    kept = gui.add_markdown("")

    def show() -> None:
        kept.content = f"Kept in `{page.folder}`" if page.folder else ""

    opened.on_click(tab.safely(lambda _: open_path(page, page.places.check(path.value))))
    page.listen(tab, "document", show)
    show()
    add_export(page, tab)


def add_export(page: Page, tab: Tab) -> None:
    """Add the list of formats, the name, and Export, which offers the file for download."""
    gui = tab.gui
    kind = gui.add_dropdown("format", (*WRITABLE, PAGE, VIDEO, PICTURE))
    name = gui.add_text("file name", "", hint="Without its ending; empty: that of the scene.")
    export = gui.add_button("Export", icon="download")

    def named(suffix: str) -> Path:
        stem = name.value.strip() or Path(page.document.source or "scene").stem
        return page.new_file(f"{stem}{suffix}")

    def act() -> None:
        scene = str(page.scene_file)
        if kind.value == PICTURE:
            return save_view(named(".png"))
        if kind.value == PAGE:
            out = named(".html")
            command = ["view", scene, "-o", str(out)]
        elif kind.value == VIDEO:
            out = named(".mp4")
            command = ["render", scene, "--path", "turntable", "--size", str(VIDEO_PIXELS)]
            command += ["--frames", str(VIDEO_FRAMES), "-o", str(out)]
        else:
            out = named(kind.value)
            command = ["convert", scene, str(out)]
        out.parent.mkdir(parents=True, exist_ok=True)
        page.run(command, f"export {out.name}", lambda record: offer(out))

    def save_view(out: Path) -> None:
        camera = tab.camera()
        out.parent.mkdir(parents=True, exist_ok=True)
        write = partial(save_picture, path=out)
        tab.soon("export", lambda: write(Image.fromarray(tab.draw(camera))), lambda _: offer(out))

    def offer(out: Path) -> None:
        tab.tell(f"{out.name} is downloaded, and kept in {out.parent}")
        tab.download(out)

    def show() -> None:
        kind.visible = name.visible = export.visible = page.has_scene

    export.on_click(tab.safely(lambda _: act()))
    page.listen(tab, "document", show)
    show()
