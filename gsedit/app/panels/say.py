"""The one box: a sentence, how it is understood, what it names on the picture, its preview, apply.

What a key begins, the next key ends: the outline of what is named comes first, then a glimpse of
the change, then the change itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path
from threading import Event, RLock
from typing import TYPE_CHECKING, Any

from torch import Tensor

from gsedit.app.chips import chips_of, offers, said
from gsedit.app.looking import marks
from gsedit.app.panels.looks import Looks
from gsedit.app.previews import Previewer
from gsedit.app.reading import Knob, Reading, knobs_of, read
from gsedit.app.tab import button
from gsedit.errors import GseditError, UsageError, on_page
from gsedit.select.saved import saved_files
from gsedit.words.read import read_instruction

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab


EXAMPLES = ("remove it", "make it brighter", "paint it glossy red", "make it half the size")
"""Sentences beside those of the looks."""
STATE = '<div class="told state" role="status">{}</div>'
NONE = button("none", "✕ the selection", label="Select nothing")
AIM, PREVIEW, MARK = "aim", "preview", "mark"
"""Keys of the work that finds what is named, that draws its change, and that numbers objects."""
PAUSE, PAUSE_SELECTED = 0.35, 1.2
"""Seconds without a key after which a preview begins; and after a click, to see what it took."""
MEASURED = 8.0
"""Seconds that an edit is measured and written, and its pictures drawn."""
TOLD = 1.0
"""Seconds of work from which it is said how long it takes."""


class Say:
    """The controls of one tab's sentence."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls to the tab."""
        self.page, self.tab, gui = page, tab, tab.gui
        self.reading: Reading | None = None
        self.knobs: tuple[Knob, ...] = ()
        self.reads, self.makes = RLock(), RLock()
        self.previewers: dict[tuple[Path, Path | None], Previewer] = {}
        """Previews by the files of the scene and of what is selected; None: nothing."""
        self.stopped = Event()
        """Whether the preview in hand is not wanted any more."""
        self.note, self.doing, self.accepted, self.marked = "", "", "", False
        self.text = gui.add_text(
            "Say what should change", "", hint="Enter applies it, Escape ends its preview."
        )
        self.apply_button = gui.add_button("Apply", icon="check", visible=False)
        self.told, self.state = gui.add_html(""), gui.add_html("")
        self.looks = Looks(page, tab)
        self.text.on_update(tab.safely(self.written))
        self.apply_button.on_click(tab.safely(lambda _: self.apply()))
        for kind in ("target", "name", "knob"):
            tab.on(kind, partial(self.turned, kind))
        tab.on("say", self.say)
        tab.on("accept", self.accept)
        tab.on("apply", lambda _: self.apply())
        tab.on("end", lambda _: self.end())
        tab.on("none", lambda _: page.select(None))
        tab.on("object", lambda number: self.choose(int(number)))
        page.listen(tab, "scene", self.forget)
        page.listen(tab, "selection", self.selected)
        tab.begin, tab.rested = self.end, self.rested
        tab.key("Apply the sentence", "enter", self.apply, "cmd/ctrl")
        self.forget()

    # -- reading

    def say(self, text: str) -> None:
        """Take a sentence that was chosen."""
        self.text.value = text
        self.typed()

    def accept(self, _: str) -> None:
        """Take the sentence although not all of it was read."""
        self.accepted = self.reading.text if self.reading is not None else ""
        self.typed()

    def written(self, event: Any) -> None:
        """Hear what a person, or `say`, has written."""
        if event.client is not None:
            self.tab.hush()
        self.typed(event.client is not None)

    def typed(self, by_person: bool = True, pause: float = PAUSE) -> None:
        """Understand the sentence, show how, outline what it names, and preview it."""
        with self.reads:  # each change of the text is told in a thread of its own
            self.understand()
            if by_person:
                for put_away in self.tab.tools:
                    put_away()
                self.aim(pause)
            self.show()

    def understand(self) -> None:
        """Read the text as it is now."""
        text, page = self.text.value.strip(" -–—•"), self.page  # "-" begins a list that was pasted
        names = self.names()
        accept = text == self.accepted
        self.reading = read(text, names, page.places, accept=accept) if text else None
        self.knobs = ()
        if self.reading is not None:
            self.knobs = knobs_of(
                self.reading.instruction, lambda each: read_instruction(each, names)
            )

    def names(self) -> tuple[str, ...]:
        """Names of the saved selections."""
        return tuple(saved_files(self.page.scene_file)) if self.page.has_scene else ()

    def show(self) -> None:
        """Show how the sentence is understood, and what is being done."""
        reading = self.reading
        known = reading is not None and not reading.refusal
        self.apply_button.disabled = not known
        self.apply_button.visible = self.text.visible = self.page.has_scene
        if reading is None:
            chips = "".join(button(f"say {each}", escape(each)) for each in EXAMPLES)
            chips = f"Such as {chips}{NONE if self.page.selection is not None else ''}"
            such = f'<div class="told reading">{chips}</div>{STATE.format("")}'
            self.told.content, self.state.content = such if self.page.has_scene else "", ""
            return
        names, selected = self.names(), self.page.selection is not None
        again = lambda each: read_instruction(each, names)  # noqa: E731
        shown = f"<p>{escape(reading.refusal)}</p>{offers(reading, names)}"
        if known:
            shown = chips_of(reading, self.knobs, again, selected=selected)
        shown += NONE if selected else ""
        # the same content leaves a list open
        self.told.content = f'<div class="told reading">{shown}</div>'
        notes = f"<p>{escape(self.note)}</p>" if self.note else ""
        self.state.content = STATE.format(notes + self.doing)

    def turned(self, kind: str, told: str) -> None:
        """Say the sentence anew, with a chip ("0 VALUE") at another value."""
        number, _, value = told.partition(" ")
        if kind == "target" and value == "scene" and self.page.selection is not None:
            self.page.select(None)  # which would confine it
        if self.reading is not None:
            self.say(said(self.reading, self.knobs, f"{kind} {number}", value))

    # -- what is named

    def aim(self, pause: float) -> None:
        """Find what the sentence names, outline it, then preview the change."""
        self.end(keep=True)
        reading = self.reading
        if reading is None or reading.refusal or not self.page.has_scene:
            self.note = ""
            return self.aimed(None, False)
        previewer, stopped = self.previewer(), self.stopped

        def find() -> Tensor | GseditError | None:
            try:
                return previewer.target(reading)
            except GseditError as error:
                return error

        def found(result: Tensor | GseditError | None) -> None:
            if not self.is_of_scene(previewer):
                return
            if isinstance(result, GseditError):
                self.note = f"{on_page(result)}. Click the one you mean, or its number."
                self.aimed(None, True)
                return self.show()
            chosen = self.page.selection is not None
            self.note = "" if chosen or result is None else "Not this? Click the right one."
            self.aimed(result, bool(self.note))
            self.show()
            self.preview(reading, pause, stopped)

        self.tab.soon(AIM, find, found)

    def aimed(self, flags: Tensor | None, numbered: bool) -> None:
        """Outline what is named, and number the objects where it may be another."""
        self.tab.name(flags)
        self.marked = numbered
        self.mark()

    def rested(self, rests: bool) -> None:
        """Number the objects where the view rests; the numbers do not follow it while it moves."""
        if self.marked:
            self.mark() if rests else self.tab.over("")

    def mark(self) -> None:
        """Lay the numbers of the objects over the picture."""
        if not self.marked or self.tab.compares or not self.page.has_scene:
            self.tab.drop(MARK)
            return self.tab.over("") if self.page.has_scene else self.tab.welcome()
        loaded, camera = self.page.loaded, self.tab.camera()
        work = lambda: marks(loaded.scene, loaded.ready().segments, camera)  # noqa: E731

        def lay(found: Any) -> None:
            places = [
                button(
                    f"object {each.number}", str(each.number), kind="mark",
                    label=f"object {each.number}", style=f"left:{each.x:.1%};top:{each.y:.1%}",
                )
                for each in found
            ]  # fmt: skip
            self.tab.over("".join(places) if self.marked else "")

        self.tab.soon(MARK, work, lay)

    def choose(self, number: int) -> None:
        """Select an object by its number."""
        loaded = self.page.loaded
        self.page.select(loaded.ready().segments.inside(number), f"object {number}")

    # -- preview and apply

    def forget(self) -> None:
        """Find everything anew: the scene is another."""
        self.tab.drop(PREVIEW)
        for each in self.previewers.values():
            each.loaded.forget()
        self.previewers.clear()
        self.selected()

    def selected(self) -> None:
        """Speak of what is selected now, and hear the names that are saved now."""
        self.end()
        for key in list(self.previewers):
            if key[1] is not None:
                self.previewers.pop(key, None)
            elif key in self.previewers:
                self.previewers[key].rename()
        if self.page.has_scene:
            self.tab.soon("prepare", self.previewer, lambda _: None)
        self.typed(pause=PAUSE_SELECTED)

    def previewer(self) -> Previewer:
        """Previews of the selection, or of what a sentence speaks of."""
        loaded, file = self.page.loaded, self.page.selection_file()
        key = loaded.file, file
        with self.makes:
            if key in self.previewers:
                return self.previewers[key]
            self.previewers[key] = made = Previewer(loaded, file)
        wanted = partial(self.keeps, key, made)
        made.prepare_behind(wanted, partial(self.looks.make, wanted))
        return made

    def keeps(self, key: tuple[Path, Path | None], previewer: Previewer) -> bool:
        """Whether these previews may still be asked for."""
        same = self.previewers.get(key) is previewer and self.is_of_scene(previewer)
        return same and not self.tab.closed

    def is_of_scene(self, previewer: Previewer) -> bool:
        """Whether these previews are of the scene that is shown."""
        return self.page.has_scene and previewer.loaded.file == self.page.scene_file

    def preview(self, reading: Reading, pause: float, stopped: Event) -> None:
        """Show the view as it would become: a glimpse, then this view, then right from all sides;
        after a pause in which the next key ends it."""
        previewer, camera, tab = self.previewer(), self.tab.camera(), self.tab
        seconds = reading.seconds(len(self.page.scene))

        def ask(work: Callable[[], Any], show: Callable[[Any], None]) -> None:
            def then(result: Any) -> None:
                if stopped.is_set() or not self.is_of_scene(previewer):
                    return
                show(result)
                if stopped.is_set() or not self.is_of_scene(previewer):  # meanwhile
                    tab.preview(None)

            tab.soon(PREVIEW, self.tried(work), then)

        def begin() -> Any:
            return None if stopped.wait(pause) else previewer.glimpse(reading, camera)

        def glimpsed(scene: Any) -> None:
            if scene is not None:
                tab.preview(scene, rough=True)
            self.work(seconds)
            if not previewer.is_exact(reading):
                return ask(partial(previewer.picture, reading, camera), drawn)
            partly = previewer.is_partial(reading)
            ask(partial(previewer.scene, reading, camera if partly else None), shown)

        def shown(made: Any) -> None:
            tab.preview(made.scene)
            self.done(made.notes, reading)
            if previewer.is_partial(reading):
                ask(partial(previewer.scene, reading), lambda whole: tab.preview(whole.scene))

        def drawn(picture: Any) -> None:
            self.done(("this view as it is drawn first; Apply paints it from all sides",), reading)
            tab.still(picture)

        ask(begin, glimpsed)

    def tried(self, work: Callable[[], Any]) -> Callable[[], Any]:
        """Work whose error ends the preview; the error is told."""

        def called() -> Any:
            try:
                return work()
            except GseditError:
                self.end()
                raise

        return called

    def work(self, seconds: float) -> None:
        """Say that a preview is drawn, and how long that takes."""
        if seconds >= TOLD:
            told = f"Drawing the preview, about {seconds:.0f} s {button('end', 'Stop')}"
            self.doing = f'<p>{told}</p><div class="bar" style="--for:{seconds:.0f}s"></div>'
            self.show()

    def done(self, notes: tuple[str, ...], reading: Reading) -> None:
        """Say that a preview is shown, with its remarks."""
        more = (f"the first of {len(reading.steps)} edits",) if len(reading.steps) > 1 else ()
        told = escape("; ".join((*more, *notes)))
        remarks = f"<details><summary>Remarks</summary>{told}</details>" if told else ""
        self.doing = f"<p>Preview {button('end', 'End')}</p>{remarks}"
        self.show()

    def end(self, *, keep: bool = False) -> None:
        """Show the scene as it is; `keep` what is told of the sentence, which is read anew."""
        self.stopped.set()
        self.stopped = Event()
        for key in (AIM, PREVIEW):
            self.tab.drop(key)
        self.doing = ""
        if self.tab.previews:
            self.tab.preview(None)
        if not keep:
            self.show()

    def asked(self) -> Reading:
        """The sentence as it was understood. Raises UsageError where it is empty."""
        if self.reading is None or self.reading.text != self.text.value.strip():
            self.typed(by_person=False)  # it was not yet
        if self.reading is None:
            raise UsageError("say what should change first, as in “turn it into bronze”")
        return self.reading

    def apply(self) -> None:
        """Edit the scene as the sentence says; the result is the next step."""
        reading = self.asked()
        if reading.refusal:
            return  # which is told below the box
        after = partial(self.applied, reading.text)
        unread = ("--accept-unread",) if reading.text == self.accepted else ()
        options = (*self.page.region_options(), *unread)
        about = MEASURED + reading.seconds(len(self.page.scene))
        self.page.step("edit", reading.text, *options, title=reading.text, after=after, about=about)

    def applied(self, said_: str) -> None:
        """Be ready for the next sentence, which may be typed already."""
        if self.text.value.strip() == said_:
            self.text.value = ""
        self.typed()


add = Say
