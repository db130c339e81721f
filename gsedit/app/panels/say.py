"""A sentence: how it is understood while it is typed, its amounts to turn, preview, apply."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gsedit.app.knobs import Knob, knobs_of, turned
from gsedit.app.previews import Previewer
from gsedit.app.reading import Reading, read
from gsedit.errors import UsageError
from gsedit.regions.saved import saved_files
from gsedit.words.called import read_called

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

EXAMPLES = (
    "turn it into bronze", "paint it glossy red", "make it night", "make it snow",
    "a thick layer of snow on it", "make it half the size", "remove it", "autumn",
)  # fmt: skip
PREVIEW = "preview"
STEP = 0.01
"""Least turn of an amount."""


def add(page: Page, tab: Tab) -> None:
    """Add the field for a sentence, its reading, its knobs, Preview and Apply."""
    Say(page, tab)


class Say:
    """The controls of one tab's sentence."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls to the tab."""
        self.page, self.tab, gui = page, tab, tab.gui
        self.reading: Reading | None = None
        self.previewer: Previewer | None = None
        self.knobs: tuple[Knob, ...] = ()
        self.handles: list[Any] = []
        self.text = gui.add_text("", "", hint="What should change, as in “turn it into bronze”.")
        self.told = gui.add_html(_HELP)
        self.folder = gui.add_folder("amounts", visible=False)
        self.buttons = gui.add_button_group("", ("Preview", "Apply"))
        self.back = gui.add_button("End the preview", icon="arrow-back", visible=False)
        self.text.on_update(tab.safely(lambda event: self.typed(event.client is not None)))
        self.buttons.on_click(tab.safely(self.pressed))
        self.back.on_click(tab.safely(lambda _: self.end()))
        for what in ("scene", "selection"):
            page.listen(tab, what, self.forget)
        tab.key("Preview the sentence", "P", self.preview, "cmd/ctrl")
        tab.key("Apply the sentence", "enter", self.apply, "cmd/ctrl")

    # -- reading

    def typed(self, by_person: bool = True) -> None:
        """Understand the sentence, and show how."""
        text = self.text.value.strip()
        if not text:
            self.reading, self.told.content = None, _HELP
            return self.turn_out(())
        page = self.page
        names = tuple(saved_files(page.scene_file)) if page.has_scene else ()
        self.reading = read(text, names)
        count = len(page.scene) if page.has_scene else 0
        self.told.content = self.reading.html(count, selected=page.selection is not None)
        if by_person:
            self.turn_out(knobs_of(self.reading.instruction, lambda each: read_called(each, names)))

    def turn_out(self, knobs: tuple[Knob, ...]) -> None:
        """Show these knobs in the place of the earlier ones."""
        if [_shape(each) for each in knobs] != [_shape(each) for each in self.knobs]:
            for handle in self.handles:
                handle.remove()
            with self.folder:
                self.handles = [self.handle_of(i, knob) for i, knob in enumerate(knobs)]
        else:
            for handle, knob in zip(self.handles, knobs, strict=True):
                handle.value = _value_of(knob)
        self.knobs = knobs
        self.folder.visible = bool(knobs)

    def handle_of(self, number: int, knob: Knob) -> Any:
        """The control of a knob."""
        gui, value = self.tab.gui, _value_of(knob)
        if knob.kind == "amount":
            handle = gui.add_slider(knob.label, knob.low, knob.high, STEP, value)
        elif knob.kind == "color":
            handle = gui.add_rgb(knob.label, value)
        else:
            marks = tuple(enumerate(knob.choices))
            handle = gui.add_slider(knob.label, 0, len(marks) - 1, 1, value, marks=marks)

        def turn(event: Any) -> None:
            if event.client is not None:  # a person, not `turn_out`
                self.turned(number, handle.value)

        handle.on_update(self.tab.safely(turn))
        return handle

    def turned(self, number: int, value: Any) -> None:
        """Say the sentence anew with a knob at another value, and preview it."""
        if self.reading is None:
            return
        knob = self.knobs[number]
        said = _said(knob, value)
        self.text.value = turned(self.reading.instruction, knob, said)
        self.typed(by_person=False)
        self.preview()

    # -- preview and apply

    def forget(self) -> None:
        """Find everything anew: the scene or the selection is another."""
        self.previewer = None
        self.back.visible = False
        if self.reading is not None:
            self.typed(by_person=False)

    def pressed(self, _: Any) -> None:
        """Preview or apply, by the button."""
        self.preview() if self.buttons.value == "Preview" else self.apply()

    def asked(self) -> Reading:
        """The sentence as it was understood. Raises UsageError where it is empty or refused."""
        if self.reading is None:
            raise UsageError("say what should change first, as in “turn it into bronze”")
        if self.reading.refusal:
            raise UsageError(self.reading.refusal)
        return self.reading

    def preview(self) -> None:
        """Show the view as it would become: quick first, then right from all sides."""
        reading, page, tab = self.asked(), self.page, self.tab
        if self.previewer is None:
            self.previewer = Previewer(page.loaded, page.selection_file())
        previewer, camera = self.previewer, tab.camera()
        if not previewer.is_exact(reading):
            return tab.soon(PREVIEW, lambda: previewer.picture(reading, camera), self.drawn)
        partial = camera if previewer.is_partial(reading) else None

        def show(routed: Any) -> None:
            self.shown(routed.scene, routed.notes if partial is None else ())
            if partial is not None:
                tab.soon(PREVIEW, lambda: previewer.scene(reading), whole)

        def whole(routed: Any) -> None:
            self.shown(routed.scene, routed.notes)

        tab.soon(PREVIEW, lambda: previewer.scene(reading, partial), show)

    def shown(self, scene: Any, notes: tuple[str, ...]) -> None:
        """Show a scene that was made for a preview."""
        self.tab.preview(scene, "; ".join(notes))
        self.back.visible = True

    def drawn(self, picture: Any) -> None:
        """Show the picture of one view until the view moves."""
        self.tab.still(picture)
        self.tab.tell("One view as it is drawn first; move to see the scene as it is.")

    def end(self) -> None:
        """Show the scene as it is."""
        self.tab.preview(None)
        self.back.visible = False

    def apply(self) -> None:
        """Edit the scene as the sentence says; the result is the next step."""
        reading = self.asked()
        file = self.page.selection_file()
        region = () if file is None else ("--region", str(file))
        self.page.step("edit", reading.text, *region, title=reading.text, after=self.applied)

    def applied(self) -> None:
        """Be ready for the next sentence."""
        self.text.value = ""
        self.typed()


_HELP = (
    '<div style="font-size:13px;line-height:1.5;padding:0 .75em .25em;opacity:.7">Say it in plain '
    f"words: {', '.join(f'“{each}”' for each in EXAMPLES)}.</div>"
)


def _shape(knob: Knob) -> tuple[Any, ...]:
    return knob.index, knob.kind, knob.label, knob.low, knob.high, knob.choices


def _value_of(knob: Knob) -> Any:
    """The value of a knob as its control has it."""
    if knob.kind == "color":
        text = str(knob.value).lstrip("#")
        return tuple(int(text[i : i + 2], 16) for i in (0, 2, 4))
    if knob.kind == "finish":
        return knob.choices.index(knob.value) if knob.value else len(knob.choices) - 1
    return float(knob.value)


def _said(knob: Knob, value: Any) -> float | str:
    """The value of a control as its knob has it."""
    if knob.kind == "color":
        return "#" + "".join(f"{int(each):02x}" for each in value)
    return knob.choices[int(value)] if knob.kind == "finish" else float(value)
