"""The history as a strip of pictures, each one click to go back; undo, redo, the step before."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from gsedit.app.panels.looks import uri_of
from gsedit.app.tab import button
from gsedit.formats.pictures import eight_bits
from rasterizer.render import render_picture

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

PIXELS = 96
"""Longer side of the picture of a step."""


def add(page: Page, tab: Tab) -> None:
    """Add the strip, its buttons and their keys."""
    strip = tab.gui.add_html("")

    def show() -> None:
        strip.content = strip_of(page)
        missing = [each.scene for each in page.document.steps if each.scene not in page.pictures]
        if missing:
            tab.soon("strip", lambda: draw(missing[-1]), lambda _: show())

    def draw(scene: str) -> None:
        assert page.folder is not None
        camera = page.load(page.file_of(0)).first_camera().fitted(PIXELS)
        drawn = render_picture(page.load(page.folder / scene).scene, camera)
        page.pictures[scene] = uri_of(eight_bits(drawn))

    def before(held: str) -> None:
        """Show the scene without its preview, or the step before, while a key is held."""
        position = page.document.position - (not tab.previews)
        tab.peek(page.load(page.file_of(max(position, 0))).scene if held == "1" else None)

    tab.on("step", lambda number: page.go_to(int(number)))
    tab.on("undo", lambda _: page.undo())
    tab.on("redo", lambda _: page.redo())
    tab.on("before", before)
    tab.on("frame", lambda _: tab.frame())
    tab.key("Undo", "Z", page.undo, "cmd/ctrl")
    tab.key("Redo", "Y", page.redo, "cmd/ctrl")
    tab.key("Frame what is selected", "F", tab.frame)
    page.listen(tab, "document", show)
    show()


def strip_of(page: Page) -> str:
    """HTML of the strip: a picture a step, the one that is shown marked, and the buttons."""
    document, known = page.document, page.pictures
    if not document.steps:
        return ""
    cells = [
        button(
            f"step {i}", f'<img alt="" src="{known[each.scene]}">{escape(each.title[:SHOWN])}'
            if each.scene in known else escape(each.title[:SHOWN]),
            kind="step now" if i == document.position else "step", label=f"{i}: {each.title}",
        )
        for i, each in enumerate(document.steps)
    ]  # fmt: skip
    tools = [
        button("frame", "Frame", label="Frame what is selected (F)"),
        '<button type="button" class="chip" data-hold="before">Hold to compare (B)</button>',
    ]
    if last := len(document.steps) - 1:
        tools += [
            button("undo", "Undo", label="Undo (Ctrl-Z)", off=document.position == 0),
            button("redo", "Redo", label="Redo (Ctrl-Y)", off=document.position == last),
        ]
    return f'<div class="strip">{"".join(cells)}</div><div class="told">{"".join(tools)}</div>'


SHOWN = 24
"""Letters of a step's title below its picture; the whole is told beside the pointer."""
