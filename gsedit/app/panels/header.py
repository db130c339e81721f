"""Above all headings: what is open, what is being done and how to end it, and a place to drop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.app.opening import receive

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab


def add(page: Page, tab: Tab) -> None:
    """Add the line of state, the progress of work with its Cancel, and the upload button."""
    gui = tab.gui
    state = gui.add_markdown("")
    doing = gui.add_markdown("", visible=False)
    bar = gui.add_progress_bar(0.0, animated=True, visible=False)
    cancel = gui.add_button("Cancel", color="red", icon="x", visible=False)
    again = gui.add_button("Go on with what was interrupted", icon="player-play", visible=False)
    upload = gui.add_upload_button("Open a file, or drop it here", icon="upload")

    def show_state() -> None:
        pending = page.document.pending
        state.content = described(page)
        again.visible = pending is not None and page.busy is None
        if pending is not None:
            again.label = f"Go on with: {pending.title}"

    def show_work() -> None:
        work = page.busy
        doing.visible = bar.visible = cancel.visible = work is not None
        if work is not None:
            doing.content = f"**{work.describe()}**\n\n{plain(work.line)}"
            bar.value = 100 * (work.share or 0.0)
        show_state()

    cancel.on_click(tab.safely(lambda _: page.cancel()))
    again.on_click(tab.safely(lambda _: page.resume()))
    upload.on_upload(tab.safely(lambda _: receive(page, upload.value)))
    for what in ("scene", "selection", "document"):
        page.listen(tab, what, show_state)
    page.listen(tab, "busy", show_work)
    show_work()


def described(page: Page) -> str:
    """One line: the scene, its size, the step, what is selected."""
    step = page.document.current
    if step is None:
        source = Path(page.document.source).name
        return f"**{plain(source)}** has no scene yet" if source else "Nothing is open yet."
    count = len(page.scene)
    parts = [f"**{plain(step.title)}**", f"{count:,} Gaussians"]
    if page.selection is not None:
        parts.append(f"{int(page.selection.sum()):,} selected")
    return " · ".join(parts)


def plain(text: str) -> str:
    """A text as Markdown that shows it as it is."""
    return "".join(f"\\{each}" if each in "\\`*_{}[]()#+-.!|<>~" else each for each in text)
