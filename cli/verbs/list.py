"""`gsedit list`: 2D editors, masks, presets, looks that can be asked for, and all settings."""

from __future__ import annotations

import json
from functools import reduce
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gsedit.errors import UsageError

from ..core.command import argument, settings_of
from ..core.console import as_json, print_message, print_result

if TYPE_CHECKING:
    from gsedit.paper.editors import Listing
    from gsedit.paper.settings import Preset


What = Annotated[
    Literal["editors", "masks", "presets", "looks", "settings"],
    argument(
        "editors|masks|presets|looks|settings",
        "editors: the 2D editors and what each needs. masks: what finds a phrase in pictures. "
        "presets: what gsedit edit --preset sets. looks: materials, lights, weather and styles. "
        "settings: what --set NAME=VALUE accepts.",
    ),
]
Name = Annotated[
    str | None,
    argument(
        "NAME",
        "looks: a sentence, to see what it asks for. settings: a verb, as edit or fit.",
    ),
]


def list_(ctx: typer.Context, what: What, name: Name = None) -> None:
    """List the 2D editors, masks, presets, looks or settings.

    gsedit list editors

    gsedit list masks

    gsedit list presets

    gsedit list looks "as if it had spent a century under the sea"

    gsedit list settings edit
    """
    nameless = {"editors": list_editors, "masks": list_masks, "presets": list_presets}
    if what in nameless:
        if name is not None:
            raise UsageError(f"{name}: list {what} takes no name")
        nameless[what]()
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
    text = "\n".join(map(str, read.changes)) if read.known else f"refused: {read.why}"
    print_result(json.loads(read.as_json()), text)


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
