"""Above all headings: what is open, what is being done and how to end it, and the next move."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.app.opening import (
    EARLIER,
    QUALITIES,
    earlier,
    go_on,
    make_scene,
    open_path,
    receive,
    waits,
)
from gsedit.capture.folder import PICTURES

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

DARK_RED = (190, 40, 40)
"""Under white letters seen well, with a contrast of 6."""
MINUTES = dict(zip(QUALITIES, ("2 minutes", "5 minutes", "15 minutes"), strict=True))
"""Time of a fit by its quality, as `gsedit fit` has it."""


def add(page: Page, tab: Tab) -> None:
    """Add the line of state, the progress of work with its Cancel, the next move where there is no
    scene yet, and the upload button."""
    gui = tab.gui
    state = gui.add_markdown("")
    doing = gui.add_markdown("", visible=False)
    bar = gui.add_progress_bar(0.0, animated=True, visible=False)
    cancel = gui.add_button("Cancel", color=DARK_RED, icon="x", visible=False)
    again = gui.add_button("Go on with what was interrupted", icon="player-play", visible=False)
    show_photos = add_photos(page, tab)
    show_earlier = add_earlier(page, tab)
    upload = gui.add_upload_button("Open files, or drop them here", icon="upload", color="gray")

    def show_state() -> None:
        pending = page.document.pending
        state.content = described(page)
        again.visible = pending is not None and page.busy is None
        if pending is not None:
            again.label = f"Go on with: {pending.title}"
        show_photos()
        show_earlier()

    def show_work() -> None:
        work = page.busy
        doing.visible = bar.visible = cancel.visible = work is not None
        if work is not None:
            of = f" of about {page.about:.0f} s" if page.about > work.watch.seconds else ""
            doing.content = f"**{work.describe()}{of}**\n\n{plain(work.line)}"
            timed = min(work.watch.seconds / page.about, 0.95) if page.about else 0.0
            bar.value = 100 * (timed if work.share is None else work.share)
        show_state()

    cancel.on_click(tab.safely(lambda _: page.worker.cancel()))
    again.on_click(tab.safely(lambda _: go_on(page)))
    add_receiving(page, tab, upload)
    for what in ("scene", "selection", "document"):
        page.listen(tab, what, show_state)
    page.listen(tab, "busy", show_work)
    show_work()


def add_receiving(page: Page, tab: Tab, upload: Any) -> None:
    """Receive the files of an upload button one after another, in the order in which they come."""
    one_thread = ThreadPoolExecutor(1)

    async def take(_: Any) -> None:  # in the event loop: the value is not yet that of another file
        one_thread.submit(tab.safely(receive), page, upload.value)

    upload.on_upload(take)


def add_photos(page: Page, tab: Tab) -> Any:
    """Add what makes a scene of photos; returns what shows it while they wait for one."""
    names = {f"{name}: {minutes}": name for name, minutes in MINUTES.items()}
    quality = tab.gui.add_dropdown(
        "quality", tuple(names), visible=False, hint="Time of the fit, once the cameras are found."
    )
    make = tab.gui.add_button("Make a scene of the photos", icon="camera", visible=False)
    make.on_click(tab.safely(lambda _: make_scene(page, names[quality.value])))

    def show() -> None:
        idle = page.busy is None and page.document.pending is None
        quality.visible = make.visible = idle and waits(page)

    return show


def add_earlier(page: Page, tab: Tab) -> Any:
    """Add buttons for the last sessions; returns what shows them while nothing is open."""
    buttons = [
        tab.gui.add_button("", icon="history", visible=False, color="gray") for _ in range(EARLIER)
    ]
    folders: list[Path] = []

    def show() -> None:
        folders[:] = earlier(page) if page.folder is None else ()
        for i, button in enumerate(buttons):
            button.visible = i < len(folders)
            if button.visible:
                button.label = f"Go on with {folders[i].stem}"

    def begin(number: int, _: Any) -> None:
        open_path(page, page.places.check(folders[number]))

    for i, button in enumerate(buttons):
        button.on_click(tab.safely(partial(begin, i)))
    return show


def described(page: Page) -> str:
    """One line: the scene, its size, the step, what is selected."""
    step = page.document.current
    if step is None:
        source = Path(page.document.source)
        if not page.document.source:
            return "Nothing is open yet: drop photos of one thing, a video, or a scene."
        return f"**{plain(source.name)}**{counted(source)}: no scene yet"
    count = len(page.scene)
    parts = [f"**{plain(step.title)}**", f"{count:,} Gaussians"]
    if page.selection is not None:
        parts.append(f"{int(page.selection.sum()):,} selected")
    return " · ".join(parts)


def counted(source: Path) -> str:
    """The number of photos in a folder; nothing for a video, or where they lie deeper."""
    count = sum(each.suffix.lower() in PICTURES for each in source.glob("*"))
    return f", {count} photos" if count else ""


def plain(text: str) -> str:
    """A text as Markdown that shows it as it is."""
    return "".join(f"\\{each}" if each in "\\`*_{}[]()#+-.!|<>~" else each for each in text)
