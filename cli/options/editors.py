"""Options of what a sentence, its editor and its views are, of `gsedit edit` and `gsedit make`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gsedit.errors import UsageError

from ..core.command import Setting, Values, option, settings_of, with_values
from ..core.console import print_message
from .cameras import ViewOptions, resolve_cameras
from .selection import MaskOptions

if TYPE_CHECKING:
    from gsedit.paper.actions import Strategy
    from gsedit.paper.diffusion.settings import Precision
    from gsedit.paper.editors import Editor
    from gsedit.paper.settings import EditSettings
    from gsedit.select.finder import Names
    from gsedit.views.viewpoints import Views
    from gsedit.words.instruction import Instruction
    from rasterizer.scene import Gaussians

STEPS = {
    ("update", "patches"),
    ("update", "patch"),
    ("strategy", "update_steps"),
    ("strategy", "steps_between"),
}
"""Settings of steps on crops."""
AUTO = "auto"
"""Name that leaves the choice of the editor to gsedit."""
OBJECTS = "objects.png"
"""Picture of the numbers of objects, where a sentence may mean several."""


@dataclass(frozen=True)
class EditorOptions:
    """Options of the 2D editor that follows the instruction."""

    editor: str = option(AUTO, "NAME")
    """2D editor (see gsedit list editors). auto: painter for painting styles, all else on the scene
    itself. Any other one draws the whole sentence."""
    like: Path | None = option(None, "PICTURE")
    """painter: the picture that has the style, for "in the style of this picture"."""
    strength: float | None = option(None, "SHARE")
    """painter: how far pictures go to the style, from 0 to 1. None: 1."""
    keep_colors: bool = option(False)
    """painter: keep the colors of the scene, and paint its brightness alone."""
    model: str | None = option()
    """pix2pix, diffusers: a folder of weights, or a Hugging Face id in the local cache."""
    runtime: str | None = option(None, "torch|openvino|auto")
    """pix2pix, diffusers: who computes the networks. auto: openvino where it is installed, measured
    faster, and as exact; its networks are kept in the cache folder. None: auto."""
    run: str | None = option(None, "COMMAND")
    """command: the program to run, as in "my_editor {input} {output} {prompt}". It must write to
    the folder {output} a PNG for each PNG in {input}. No shell is involved."""
    timeout: float | None = option(flags=None)
    """command: seconds that the program may take for the views of a batch. None: no limit."""

    def settled(self) -> EditorOptions:
        """Return the options with the default editor where gsedit may choose one."""
        from gsedit.paper.editors.registry import DEFAULT

        return replace(self, editor=DEFAULT) if self.editor == AUTO else self

    @property
    def draws_all(self) -> bool:
        """Whether the editor gets the whole sentence as it is, and not only its styles."""
        from gsedit.paper.editors.registry import DEFAULT

        return self.settled().editor != DEFAULT

    def make(self, out: Path, step: Instruction | None, precision: Precision = "auto") -> Editor:
        """Make the editor, which may keep files below `out`.

        Raises UsageError for an option that it does not have, or a step that it cannot follow
        (None: it need not follow any).
        """
        from gsedit.paper.editors import make_editor
        from gsedit.paper.editors.protocol import following

        given = {**vars(self.settled()), "keep_colors": self.keep_colors or None}
        name, folder = given.pop("editor"), out / "command"
        editor = make_editor(name, **given, folder=folder, precision=precision)
        if step is not None:
            following(editor, step)
        return editor


def at_size(settings: EditSettings, editor: Editor, size: int | None) -> EditSettings:
    """Return the settings with --size as the editor's too, where that was made for more.

    Prints a line then: an editor draws worse at a size that it was not trained at.
    """
    declared = editor.capabilities
    made_for = declared.best_size
    if size is None or settings.edit_size or not made_for or not declared.enlarges:
        return settings
    if size < made_for:
        print_message(
            f"--size {size}: this model was made for {made_for} pixels and draws worse below; "
            "leave --size out for its own, which takes longer"
        )
    return replace(settings, edit_size=min(size, made_for))


def edit_settings() -> list[Setting]:
    """Return every option that comes from a field of EditSettings or of a strategy.

    Raises TypeError where strategies have fields of one name and different types.
    """
    from gsedit.paper.settings import EditSettings
    from gsedit.paper.strategies import DEFAULT, find_strategy, strategy_names

    strategies = {name: find_strategy(name) for name in strategy_names()}
    meaning = (
        "When views are edited and when the scene is fitted to them (docs/concepts/strategies.md)."
    )
    kind = Literal[tuple(strategies)]
    choice = Setting(("strategy",), ("--strategy",), kind, meaning, DEFAULT)
    return [choice, *strategy_settings(strategies), *settings_of(EditSettings())]


def strategy_settings(strategies: dict[str, type[Strategy]]) -> list[Setting]:
    """Return an option for each field of any strategy; its help names the strategies with it."""
    options: dict[str, Setting] = {}
    owners: dict[str, list[str]] = {}
    for name, strategy in strategies.items():
        for setting in settings_of(strategy(), ("strategy",)):
            owners.setdefault(setting.name, []).append(name)
            earlier = options.get(setting.name, setting)
            if earlier.type != setting.type:
                raise TypeError(
                    f"{'.'.join(setting.path)} of {' and '.join(owners[setting.name])} is a "
                    f"{setting.type} and a {earlier.type}: give the field another name"
                )
            negatable = setting.negatable or earlier.negatable
            default = setting.default if setting.default == earlier.default else "by strategy"
            options[setting.name] = replace(earlier, negatable=negatable, default=default)
    return [
        replace(each, meaning=f"{each.meaning} Of {', '.join(owners[name])}.")
        for name, each in options.items()
    ]


def resolve(preset: str, values: Values) -> tuple[EditSettings, Strategy]:
    """Return the settings and the strategy: values of the preset, replaced by given ones.

    Raises UsageError for a value out of range, and a setting that another strategy has.
    """
    from gsedit.paper.settings import find_preset
    from gsedit.paper.strategies import DEFAULT, find_strategy, strategy_names

    named, name = find_preset(preset), values.get(("strategy",), DEFAULT)
    shared = {path: value for path, value in values.items() if path[0] != "strategy"}
    own = {path: value for path, value in values.items() if path[0] == "strategy"}
    chosen = {path[1:]: value for path, value in own.items() if path[1:]}
    for (field_name,) in chosen:
        classes = {each: find_strategy(each) for each in strategy_names()}
        known = {each: {s.path[0] for s in settings_of(kind)} for each, kind in classes.items()}
        owners = [each for each, names in known.items() if field_name in names]
        if name not in owners:
            raise UsageError(
                f"{field_name} is a setting of the strategy {' and '.join(owners)}, not of {name}: "
                f"leave it out, or add --strategy {owners[0]}"
            )
    strategy = with_values(named.applied_to(find_strategy(name)()), chosen)
    return with_values(named.settings, shared), strategy


def idle_settings(values: Values, settings: EditSettings) -> list[str]:
    """Return the settings that were given and do nothing, since colors are solved for at once."""
    from gsedit.paper.strategies import DEFAULT

    if not settings.solves or values.get(("strategy",), DEFAULT) != DEFAULT:
        return []
    return sorted(".".join(path) for path in STEPS & values.keys())


def asks_editor(editor: EditorOptions, values: Values) -> bool:
    """Whether an option is for what a 2D editor draws."""
    from gsedit.editing.plan import HEEDED

    return editor != EditorOptions() or any(path[0] not in HEEDED for path in values)


def read_sentence(
    text: str, scene: Path | None = None, *, drawn: bool = False, accept_unread: bool = False
) -> tuple[Instruction, ...]:
    """Return the steps of a sentence, in order; where all is `drawn`, one with the sentence as is.

    Names of the selections that are saved beside the scene are what they were saved for.
    Raises UsageError for a sentence that is refused, InputError for a file to put in that is none.
    """
    from gsedit.editing.plan import read_steps
    from gsedit.formats.files import open_scene
    from gsedit.select.saved import saved_files

    names = () if scene is None else tuple(saved_files(scene))
    steps = read_steps(text, names, drawn=drawn, accept_unread=accept_unread)
    for change in (each for step in steps for each in step.changes):
        if change.name == "insert":
            open_scene(change.phrase)  # before the long work
    return steps


def names_of(scene: Path, masks: MaskOptions, steps: Sequence[Instruction]) -> Names:
    """Return what the phrases of a sentence may name: saved selections, and what masks find.

    Raises UsageError for masks that cannot look for a phrase, or that have none to look for.
    """
    from gsedit.editing.plan import PICTURE
    from gsedit.select.finder import Names
    from gsedit.select.saved import saved_files
    from gsedit.words.phrases import IT

    if any(each.route == PICTURE for step in steps for each in step.changes):
        masks.check_unused()
    phrases = [each.phrase for step in steps for each in step.changes]
    told = next((phrase for phrase in phrases if phrase not in ("", IT)), None)
    if masks.masks is not None and told is None:
        raise UsageError('--masks finds what a sentence names, as in "remove the chair": say that')
    return Names(saved_files(scene), masks.make(told))


def views_of(path: Path, scene: Gaussians, options: ViewOptions, *, drawn: bool) -> Views:
    """Return the views of an edit: photos of --data that a 2D editor may be shown, or cameras.

    Of many recorded cameras a 2D editor is shown views from some.
    """
    from gsedit.views.lazy_views import of_one_size
    from gsedit.views.viewpoints import same_size

    resolved = resolve_cameras(path, scene, options)
    if drawn and resolved.photos is not None:
        framed = of_one_size(resolved.photos)
        if framed is not resolved.photos:
            print_message(framed.notes[-1])
        return framed
    sized = replace(resolved, viewpoints=same_size(resolved.viewpoints, options.pixels))
    return sized.some(scene) if drawn else sized.viewpoints


@contextmanager
def numbered(file: Path, scene: Gaussians, views: Views) -> Iterator[None]:
    """Draw the numbers of a scene's objects into a file where a sentence may mean several."""
    from gsedit.editing.parts import SeveralObjects
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.segment_sheet import segment_sheet
    from gsedit.select.phrase import names
    from gsedit.views.viewpoints import viewpoints_of

    try:
        yield
    except SeveralObjects as error:
        viewpoints = viewpoints_of(views)
        sheet = segment_sheet(scene, error.segments, names(error.segments), viewpoints)
        file.parent.mkdir(parents=True, exist_ok=True)
        save_picture(sheet, file, overwrite=True)
        raise UsageError(f"{error}; their numbers are drawn in {file}") from None
