"""The history: every step, back to any, and two results compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

NO, WIPE, BESIDE = "no", "wipe", "side by side"
BEFORE_LAST = "the step before"


def add(page: Page, tab: Tab) -> None:
    """Add the list of steps, Undo and Redo, and the comparison of two of them."""
    gui = tab.gui
    buttons = gui.add_button_group("", ("Undo", "Redo"))
    steps = gui.add_dropdown("step", ("—",))
    how = gui.add_markdown("")
    ways = gui.add_button_group("compare", (NO, WIPE, BESIDE))
    other = gui.add_dropdown("with", (BEFORE_LAST,))
    line = gui.add_slider("line", min=0.0, max=1.0, step=0.01, initial_value=0.5)

    def show() -> None:
        document = page.document
        names = tuple(f"{i}: {each.title}" for i, each in enumerate(document.steps)) or ("—",)
        steps.options = names
        steps.value = names[max(document.position, 0)]
        other.options = (BEFORE_LAST, *names)
        command = document.current.command if document.current else ()
        how.content = f"`{commanded(command)}`" if command else ""

    def compare(way: str) -> None:
        if way == NO:
            return tab.compare(None)
        position = page.document.position - 1
        if other.value != BEFORE_LAST:
            position = int(other.value.split(":")[0])
        before = page.load(page.file_of(max(position, 0))).scene
        tab.compare(before, "wipe" if way == WIPE else "beside", line.value)

    def flip() -> None:
        """Show the step before, or the current one again."""
        if tab.previews:
            return tab.preview(None)
        tab.preview(page.load(page.file_of(max(page.document.position - 1, 0))).scene)

    @buttons.on_click
    @tab.safely
    def _(_) -> None:
        page.undo() if buttons.value == "Undo" else page.redo()

    @steps.on_update
    @tab.safely
    def _(event) -> None:
        if event.client is not None and steps.value != "—":  # a person, not `show`
            page.go_to(int(steps.value.split(":")[0]))

    ways.on_click(
        tab.safely(lambda _: tab.soon("compare", lambda: compare(ways.value), lambda _: None))
    )
    line.on_update(tab.safely(lambda _: tab.wipe(line.value)))
    tab.key("Undo", "Z", page.undo, "cmd/ctrl")
    tab.key("Redo", "Y", page.redo, "cmd/ctrl")
    tab.key("Before / after", "B", flip)
    page.listen(tab, "document", show)
    show()


def commanded(command: tuple[str, ...]) -> str:
    """A command line as one would type it, with the scene's and the result's places left out."""
    words = [command[0], *command[2:]]
    if "-o" in words:
        del words[words.index("-o") : words.index("-o") + 2]
    return "gsedit " + " ".join(f'"{each}"' if " " in each else each for each in words)
