"""Two steps at once; the command of the step that is shown; what undone steps take on the disk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsedit.errors import UsageError

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

ONE, WIPE, BESIDE = "one scene", "wipe", "side by side"
BEFORE = "the step before"
NOTHING = "—"


def add(page: Page, tab: Tab) -> None:
    """Add the ways to see two steps at once, the command of the step, and what undone ones take."""
    how = tab.gui.add_markdown("")
    ways = tab.gui.add_button_group("show", (ONE, WIPE, BESIDE))
    other = tab.gui.add_dropdown("left", (BEFORE,), visible=False)
    line = tab.gui.add_slider("line", 0.0, 1.0, 0.01, 0.5, visible=False)

    def compare() -> None:
        if ways.value == ONE:
            tab.compare(None)
            return look()
        if len(page.document.steps) < 2 and not tab.previews:
            raise UsageError("there is nothing to compare with: say a change first, and apply it")
        position = page.document.position - (not tab.previews)
        if other.value != BEFORE:
            position = number_of(other.value)
        before = page.load(page.file_of(max(position, 0))).scene
        tab.compare(before, "wipe" if ways.value == WIPE else "beside", line.value)
        look()

    def look() -> None:
        other.visible, line.visible = tab.compares, tab.compares and ways.value == WIPE

    def show() -> None:
        other.options = (BEFORE, *step_names(page))
        command = page.document.current.command if page.document.current else ()
        how.content = f"`{commanded(command)}`" if command else ""
        look()

    ways.on_click(tab.safely(lambda _: compare()))
    other.on_update(tab.safely(lambda _: compare() if tab.compares else None))
    line.on_update(tab.safely(lambda _: tab.wipe(line.value)))
    page.listen(tab, "document", show)
    show()
    add_discard(page, tab)


def add_discard(page: Page, tab: Tab) -> None:
    """Add the button that deletes what undone steps take on the disk, pressed twice."""
    discard = tab.gui.add_button("", icon="trash", color="gray", visible=False)
    sure = False

    def ask(again: bool) -> None:
        nonlocal sure
        (folders, size), sure = page.undone(), again
        discard.visible = bool(folders)
        what = f"undone steps, {size / 1e6:,.0f} MB"
        discard.label = f"Press again: delete {what}" if sure else f"Delete {what}"

    discard.on_click(tab.safely(lambda _: page.discard_undone() if sure else ask(True)))
    page.listen(tab, "document", lambda: ask(False))
    ask(False)


def step_names(page: Page) -> tuple[str, ...]:
    """The steps with their numbers, in order."""
    names = tuple(f"{i}: {each.title}" for i, each in enumerate(page.document.steps))
    return names or (NOTHING,)


def number_of(name: str) -> int:
    """The number of a step's name."""
    return int(name.split(":")[0])


def commanded(command: tuple[str, ...]) -> str:
    """A command line as one would type it, without the places of the scene and the result."""
    words = [command[0], *command[2:]]
    if "-o" in words:
        del words[words.index("-o") : words.index("-o") + 2]
    return "gsedit " + " ".join(f'"{each}"' if " " in each else each for each in words)
