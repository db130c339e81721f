"""`gsedit list`: 2D editors, masks, presets, looks, painting styles, and all settings."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gsedit.errors import UsageError

from ..core.command import argument, option, settings_of
from ..core.console import as_json, print_message, print_result
from ..core.outputs import check_file
from ..options.cameras import ViewOptions, resolve_cameras
from ..options.common import Writes, first_scene, load_scene

if TYPE_CHECKING:
    from gsedit.paper.editors import Listing
    from gsedit.paper.settings import Preset


What = Annotated[
    Literal["editors", "masks", "presets", "looks", "styles", "settings"],
    argument(
        "editors|masks|presets|looks|styles|settings",
        "editors: the 2D editors and what each needs. masks: what finds a phrase in pictures. "
        "presets: what gsedit edit --preset sets. looks: materials, lights, weather and styles. "
        "styles: the painting styles, and what asks for them. "
        "settings: what --set NAME=VALUE accepts.",
    ),
]
Name = Annotated[
    str | None,
    argument(
        "NAME",
        "looks: a sentence, to see what it asks for. styles: a scene, to see them on it. "
        "settings: a verb, as edit or fit.",
    ),
]


@dataclass(frozen=True)
class ListOptions(Writes):
    """The picture that shows styles."""

    out: Path | None = option(None, "PNG", flags="--output -o")
    """styles with a scene: picture to write, one view of the scene in every style."""


def list_(ctx: typer.Context, what: What, name: Name = None, *, own: ListOptions) -> None:
    """List the 2D editors, masks, presets, looks, styles or settings.

    gsedit list editors

    gsedit list masks

    gsedit list presets

    gsedit list looks "as if it had spent a century under the sea"

    gsedit list styles scene.ply -o styles.png

    gsedit list settings edit
    """
    if own.out is not None and (what != "styles" or name is None):
        raise UsageError("-o is for the styles of a scene: gsedit list styles SCENE -o styles.png")
    nameless = {"editors": list_editors, "masks": list_masks, "presets": list_presets}
    if what in nameless:
        if name is not None:
            raise UsageError(f"{name}: list {what} takes no name")
        nameless[what]()
    elif what == "styles":
        list_styles(None if name is None else first_scene(Path(name)), own)
    elif what == "settings":
        list_settings(ctx.find_root().command, name or "edit")
    elif name is not None:
        explain_sentence(name)
    else:
        list_looks()


def list_editors() -> None:
    """Print every 2D editor, of gsedit and of other packages."""
    from gsedit.paper.editors import list_editors

    for listing in list_editors():
        record = {**vars(listing), "ready": listing.ready}
        print_result(record, editor_text(listing))
    if not as_json.get():
        print_message(
            "use one: gsedit edit ... --editor NAME; write one: see examples/write_an_editor.py"
        )


def list_masks() -> None:
    """Print every mask provider, of gsedit and of other packages."""
    from gsedit.paper.editors.registry import MASKS

    for each in MASKS.list():
        record, origin = {**vars(each), "ready": each.ready}, f"from {each.source}"
        text = each.summary if each.source == "gsedit" else origin
        print_result(record, f"{each.name:<12} {text}")
    if not as_json.get():
        print_message(
            'use one: gsedit select ... --phrase "the chair" --masks NAME, or gsedit edit ... '
            "--masks NAME"
        )


def list_presets() -> None:
    """Print the settings that each preset of `gsedit edit` sets."""
    from gsedit.paper.settings import PRESETS

    for name, preset in PRESETS.items():
        values = preset_values(preset)
        record = {"name": name, "meaning": preset.meaning, "sets": values}
        lines = [f"{name:<12} {preset.meaning}", *(f"{k}={v}" for k, v in values.items())]
        print_result(record, "\n    ".join(lines))


def preset_values(preset: Preset) -> dict[str, Any]:
    """Return by name the values of a preset that are not the defaults."""
    from gsedit.paper.settings import EditSettings

    values = {f"strategy.{name}": value for name, value in preset.strategy.items()}
    for path in (setting.path for setting in settings_of(EditSettings())):
        own, usual = (reduce(getattr, path, each) for each in (preset.settings, EditSettings()))
        if own != usual:
            values[".".join(path)] = own
    return values


def editor_text(listing: Listing) -> str:
    """Return an editor's name and summary, and a line for each thing that is missing."""
    state = "ready" if listing.ready else "not ready"
    origin = f" (from {listing.source})" if listing.source != "gsedit" else ""
    lines = [f"{listing.name:<12} {state}{origin}", listing.summary]
    if listing.options:
        lines.append(f"takes {' '.join(listing.options)}")
    lines += [f"needs {need}" for need in listing.needs]
    return "\n    ".join(line for line in lines if line)


def list_looks() -> None:
    """Print every material, light, weather and painting style that a sentence may name."""
    from gsedit.words.lexicon import looks

    for kind, names in looks().items():
        for name in names:
            print_result({"name": name, "kind": kind}, f"{kind:<10} {name}")
    if not as_json.get():
        print_message('test a sentence: gsedit list looks "SENTENCE"')


def explain_sentence(sentence: str) -> None:
    """Print the changes that a sentence asks for, or why it is refused.

    Raises UsageError for an empty one.
    """
    from gsedit.words.read import read_instruction

    if not sentence.strip():
        raise UsageError("the sentence is empty: say what should change, as in 'make it snow'")
    read = read_instruction(sentence)
    left = (f"not read: {each!r}" for each in read.unread)
    text = "\n".join((*map(str, read.changes), *left)) if read.known else f"refused: {read.why}"
    print_result(json.loads(read.as_json()), text)


def list_styles(scene: Path | None, own: ListOptions) -> None:
    """Print every painting style and what asks for it, or paint a view of a scene in each.

    Raises UsageError where only one of the scene and the picture is named.
    """
    if scene is not None:
        return show_styles(scene, own)
    from gsedit.words.lexicon import phrases_of_styles

    for name, phrases in phrases_of_styles().items():
        print_result({"name": name, "words": phrases}, f"{name}\n    {', '.join(phrases)}")
    if not as_json.get():
        print_message("see them on a scene: gsedit list styles SCENE -o styles.png")


def show_styles(scene: Path, own: ListOptions) -> None:
    """Write a sheet of the painting styles on a view of a scene."""
    from gsedit.formats.pictures import save_picture
    from gsedit.paper.editors.painter.editor import SHEET_CELL, style_sheet

    if own.out is None:
        raise UsageError(
            f"name the picture of the styles: gsedit list styles {scene} -o styles.png"
        )
    check_file(own.out, own.force, ".png")
    gaussians = load_scene(scene, drop_invalid=False)
    found = resolve_cameras(scene, gaussians, ViewOptions(size=SHEET_CELL))
    save_picture(style_sheet(gaussians, found.viewpoints), own.out, overwrite=own.force)
    print_result({"scene": scene, "output": own.out}, str(own.out))


def list_settings(program: Any, verb: str) -> None:
    """Print the name, the default and the meaning of every setting of a verb."""
    settings = list(program.commands[verb].settings()) if verb in program.commands else []
    if not settings:
        raise UsageError(f"{verb} has no settings: name a verb, as edit, fit or clean")
    for setting in settings:
        name, default = ".".join(setting.path), setting.default
        record = {
            "name": name, "flag": next(iter(setting.flags), None), "default": default,
            "meaning": setting.meaning,
        }  # fmt: skip
        value = f" [{default}]" if default else ""
        print_result(record, f"{name}{value}\n    {setting.meaning}")
