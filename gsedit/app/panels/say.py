"""A sentence: how it is understood while it is typed, its amounts to turn, preview, apply; and
painting styles, each on the current view."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from gsedit.app.previews import Previewer
from gsedit.app.reading import LEAST, Knob, Reading, knobs_of, read, turned
from gsedit.errors import UsageError
from gsedit.scene.picture import render_picture
from gsedit.select.saved import saved_files
from gsedit.words.read import read_instruction
from gsedit.words.instruction import MORE, Change, sentence_of
from gsedit.words.lexicon import styles

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab


EXAMPLES = (
    "turn it into bronze", "paint it glossy red", "make it night", "make it snow",
    "a thick layer of snow on it", "make it half the size", "remove it", "autumn",
    "like Van Gogh",
)  # fmt: skip
PREVIEW = "preview"
STEP = 0.01
"""Least turn of an amount."""


class Say:
    """The controls of one tab's sentence."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls to the tab."""
        self.page, self.tab, gui = page, tab, tab.gui
        self.reading: Reading | None = None
        self.reads, self.makes = RLock(), RLock()
        self.previewers: dict[tuple[Path, Path | None], Previewer] = {}
        """Previews by the files of the scene and of what is selected; None: nothing."""
        self.knobs: tuple[Knob, ...] = ()
        self.handles: list[Any] = []
        self.text = gui.add_text("say", "", hint="What should change, as in “turn it into bronze”.")
        self.told = gui.add_html(_HELP)
        self.folder = gui.add_folder("amounts", visible=False)
        self.tones = self.add_tones()
        self.styles = Styles(self)
        self.buttons = gui.add_button_group("", ("Preview", "Apply"))
        self.waits = gui.add_markdown("*Working on the preview…*", visible=False)
        self.back = gui.add_button("End the preview", icon="arrow-back", visible=False)
        self.text.on_update(tab.safely(lambda event: self.typed(event.client is not None)))
        self.buttons.on_click(tab.safely(self.pressed))
        self.back.on_click(tab.safely(lambda _: self.end()))
        page.listen(tab, "scene", self.forget)
        page.listen(tab, "selection", self.selected)
        tab.key("Preview the sentence", "P", self.preview, "cmd/ctrl")
        tab.key("Apply the sentence", "enter", self.apply, "cmd/ctrl")
        self.forget()

    def add_tones(self) -> dict[str, Any]:
        """Sliders of the whole scene's tones, or the selection's: they write the sentence."""
        sliders = {}
        with self.tab.gui.add_folder("tone", expand_by_default=False):
            for name, (more, less) in MORE.items():
                label = f"{less} / {more}"
                sliders[name] = self.tab.gui.add_slider(label, -LEAST, 1.0, STEP, 0.0)
        for slider in sliders.values():
            slider.on_update(self.tab.safely(self.toned))
        return sliders

    def toned(self, event: Any) -> None:
        """Say what the tone sliders are at, and preview it."""
        if event.client is None:  # `applied`, not a person
            return
        target = "scene" if self.page.selection is None else "subject"
        values = {name: slider.value for name, slider in self.tones.items() if slider.value}
        changes = [Change(target, "tone", k, None, v, "tone") for k, v in values.items()]
        self.text.value = sentence_of(changes) or ""
        self.typed()
        self.preview() if changes else self.end()

    # -- reading

    def typed(self, by_person: bool = True) -> None:
        """Understand the sentence, and show how."""
        with self.reads:  # each change of the text is told in a thread of its own
            self.understand(by_person)

    def understand(self, by_person: bool) -> None:
        """Read the text as it is now."""
        text = self.text.value.strip(" -–—•")  # of a list that was pasted; "-" begins an option
        if not text:
            self.reading, self.told.content = None, _HELP
            return self.turn_out(())
        page = self.page
        names = tuple(saved_files(page.scene_file)) if page.has_scene else ()
        self.reading = read(text, names, page.places)
        count = len(page.scene) if page.has_scene else 0
        self.told.content = self.reading.html(count, selected=page.selection is not None)
        if by_person:
            self.turn_out(
                knobs_of(self.reading.instruction, lambda each: read_instruction(each, names))
            )

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
        """Find everything anew: the scene is another."""
        self.tab.drop(PREVIEW)
        for each in self.previewers.values():
            each.loaded.forget()
        self.previewers.clear()
        self.back.visible = self.waits.visible = False
        self.selected()

    def selected(self) -> None:
        """Speak of what is selected now, and hear the names that are saved now."""
        for key in list(self.previewers):
            if key[1] is not None:
                self.previewers.pop(key, None)
            elif key in self.previewers:
                self.previewers[key].rename()
        if self.page.has_scene:
            self.tab.soon("prepare", self.previewer, lambda _: None)
        if self.reading is not None:
            self.typed(by_person=False)

    def previewer(self) -> Previewer:
        """Previews of the selection, or of what a sentence speaks of."""
        loaded, file = self.page.loaded, self.page.selection_file()
        key = loaded.file, file
        with self.makes:
            if key in self.previewers:
                return self.previewers[key]
            self.previewers[key] = made = Previewer(loaded, file)
        made.prepare_behind(partial(self.keeps, key, made))
        return made

    def keeps(self, key: tuple[Path, Path | None], previewer: Previewer) -> bool:
        """Whether these previews may still be asked for."""
        same = self.previewers.get(key) is previewer and self.is_of_scene(previewer)
        return same and not self.tab.closed

    def is_of_scene(self, previewer: Previewer) -> bool:
        """Whether these previews are of the scene that is shown."""
        return self.page.has_scene and previewer.loaded.file == self.page.scene_file

    def while_shown(
        self, previewer: Previewer, then: Callable[[Any], None]
    ) -> Callable[[Any], None]:
        """Show a result unless another scene has come meanwhile, which tells no tab again."""

        def called(result: Any) -> None:
            if self.is_of_scene(previewer):
                then(result)
            if not self.is_of_scene(previewer):  # it came while this was shown, too
                self.tab.preview(None)
                self.back.visible = False

        return called

    def pressed(self, _: Any) -> None:
        """Preview or apply, by the button."""
        self.preview() if self.buttons.value == "Preview" else self.apply()

    def asked(self) -> Reading:
        """The sentence as it was understood. Raises UsageError where it is empty or refused."""
        if self.reading is None or self.reading.text != self.text.value.strip():
            self.typed()  # it was not yet
        if self.reading is None:
            raise UsageError("say what should change first, as in “turn it into bronze”")
        if self.reading.refusal:
            raise UsageError(self.reading.refusal)
        return self.reading

    def preview(self) -> None:
        """Show the view as it would become: quick first, then right from all sides."""
        reading, tab = self.asked(), self.tab
        previewer, camera = self.previewer(), tab.camera()
        self.waits.visible = self.back.visible = True
        if not previewer.is_exact(reading):
            picture = self.waited(lambda: previewer.picture(reading, camera))
            return tab.soon(PREVIEW, picture, self.while_shown(previewer, self.drawn))
        one_view = camera if previewer.is_partial(reading) else None

        def show(routed: Any) -> None:
            self.shown(routed.scene, routed.notes if one_view is None else ())
            if one_view is not None:
                self.waits.visible = True
                work = self.waited(lambda: previewer.scene(reading))
                tab.soon(PREVIEW, work, self.while_shown(previewer, whole))

        def whole(routed: Any) -> None:
            self.shown(routed.scene, routed.notes)

        work = self.waited(lambda: previewer.scene(reading, one_view))
        tab.soon(PREVIEW, work, self.while_shown(previewer, show))

    def waited(self, work: Callable[[], Any]) -> Callable[[], Any]:
        """Work at whose end, or error, nothing is said to be worked on any more."""

        def done() -> Any:
            try:
                return work()
            finally:
                self.waits.visible = False

        return done

    def shown(self, scene: Any, notes: tuple[str, ...]) -> None:
        """Show a scene that was made for a preview."""
        more = len(self.reading.steps) if self.reading is not None else 1
        first = (f"the first of {more} edits",) if more > 1 and notes else ()
        self.tab.preview(scene, "; ".join((*first, *notes)))
        self.back.visible = True

    def drawn(self, picture: Any) -> None:
        """Show the picture of one view until the view moves."""
        self.tab.still(picture)
        self.tab.tell("One view as it is drawn first; move to see the scene as it is.")

    def end(self) -> None:
        """Show the scene as it is."""
        self.tab.drop(PREVIEW)
        self.tab.preview(None)
        self.back.visible = self.waits.visible = False

    def apply(self) -> None:
        """Edit the scene as the sentence says; the result is the next step."""
        reading = self.asked()
        after = partial(self.applied, reading.text)
        options = self.page.region_options()
        self.page.step("edit", reading.text, *options, title=reading.text, after=after)

    def applied(self, said: str) -> None:
        """Be ready for the next sentence, which may be typed already."""
        if self.text.value.strip() == said:
            self.text.value = ""
        for slider in self.tones.values():
            slider.value = 0.0
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


add = Say


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
            from gsedit.pictures.contact_sheet import captioned

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
