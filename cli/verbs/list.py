"""`gsedit list`: 2D editors, masks, presets, the looks of the editor `small`, and all settings."""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import reduce
from typing import TYPE_CHECKING, Annotated, Any, Literal

from gsedit.errors import UsageError

from ..core.command import argument
from ..core.console import print_message, print_result
from ..options.common import Common

if TYPE_CHECKING:
    from gsedit.editors import Listing
    from gsedit.paper.settings import Preset

    from ..options.settings import Setting


What = Annotated[
    Literal["editors", "masks", "presets", "looks", "settings"],
    argument(
        "editors|masks|presets|looks|settings",
        "editors: the 2D editors and what each needs. masks: what finds a phrase in pictures. "
        "presets: what gsedit edit --preset sets. looks: the changes that the editor small knows. "
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


def list_(what: What, name: Name = None, *, common: Common) -> None:
    """List the 2D editors, masks, presets, looks or settings.

    gsedit list editors

    gsedit list masks

    gsedit list presets

    gsedit list looks "as if it had spent a century under the sea"

    gsedit list settings edit
    """
    common.apply()
    if what in ("editors", "masks", "presets") and name is not None:
        raise UsageError(f"{name}: list {what} takes no name")
    if what == "editors":
        list_editors(as_json=common.json)
    elif what == "masks":
        list_masks(as_json=common.json)
    elif what == "presets":
        list_presets(as_json=common.json)
    elif what == "settings":
        list_settings(name or "edit", as_json=common.json)
    elif name is not None:
        explain_sentence(name, as_json=common.json)
    else:
        list_looks(as_json=common.json)


def list_editors(*, as_json: bool) -> None:
    """Print every 2D editor, of gsedit and of other packages."""
    from gsedit.editors import list_editors

    for listing in list_editors():
        record = {**vars(listing), "ready": listing.ready}
        print_result(record, editor_text(listing), as_json=as_json)
    if not as_json:
        print_message(
            "use one: gsedit edit ... --editor NAME; write one: see examples/write_an_editor.py"
        )


def list_masks(*, as_json: bool) -> None:
    """Print every mask provider, of gsedit and of other packages."""
    from gsedit.editors.registry import MASKS

    for each in MASKS.list():
        record, origin = {**vars(each), "ready": each.ready}, f"from {each.source}"
        text = each.summary if each.source == "gsedit" else origin
        print_result(record, f"{each.name:<12} {text}", as_json=as_json)
    if not as_json:
        print_message(
            'use one: gsedit select ... --phrase "the chair" --masks NAME, or gsedit edit ... '
            "--masks NAME"
        )


def list_presets(*, as_json: bool) -> None:
    """Print the options that each preset of `gsedit edit` sets."""
    from gsedit.paper.settings import PRESETS

    from .edit import all_settings

    for name, preset in PRESETS.items():
        values = preset_values(preset, all_settings())
        record = {"name": name, "meaning": preset.meaning, "sets": values}
        lines = [f"{name:<12} {preset.meaning}", *(f"{k} {v}" for k, v in values.items())]
        print_result(record, "\n    ".join(lines), as_json=as_json)


def preset_values(preset: Preset, settings: Iterable[Setting]) -> dict[str, Any]:
    """Return by flag the values of a preset that are not the defaults."""
    from gsedit.paper.settings import EditSettings

    values: dict[str, Any] = {}
    for setting in settings:
        if setting.path[0] == "strategy":
            if setting.path[-1] in preset.strategy:
                values[setting.flag] = preset.strategy[setting.path[-1]]
            continue
        own, usual = (
            reduce(getattr, setting.path, each) for each in (preset.settings, EditSettings())
        )
        if own != usual:
            flag = setting.flag
            values[f"--no-{flag.removeprefix('--')}" if own is False else flag] = own
    return {flag: "" if value is False else value for flag, value in values.items()}


def editor_text(listing: Listing) -> str:
    """Return an editor's name and summary, and a line for each thing that is missing."""
    state = "ready" if listing.ready else "not ready"
    origin = f" (from {listing.source})" if listing.source != "gsedit" else ""
    lines = [f"{listing.name:<12} {state}{origin}", listing.summary]
    if listing.options:
        lines.append(f"takes {' '.join(listing.options)}")
    lines += [f"needs {need}" for need in listing.needs]
    return "\n    ".join(line for line in lines if line)


def list_looks(*, as_json: bool) -> None:
    """Print every look, those of the subject first."""
    from gsedit.words.direct import UNCLEAR
    from gsedit.words.looks import LOOKS

    for look in LOOKS.values():
        record = {"name": look.name, "scope": look.scope, "wording": look.wording}
        print_result(record, f"{look.name:<16} {look.scope:<8} {look.wording}", as_json=as_json)
    if not as_json:
        print_message(
            "ask in your own words, for one look of the subject, one of the scene, or both; test a "
            'sentence: gsedit list looks "SENTENCE"\n'
            "--editor small draws all of these. By default they are done on the Gaussians, "
            f"{', '.join(sorted(UNCLEAR))} are refused, and small draws only what is asked for "
            "as impressionist: its watercolor, hardly seen"
        )


def explain_sentence(sentence: str, *, as_json: bool) -> None:
    """Print the changes that a sentence asks for, or why it is refused.

    Raises UsageError for an empty one.
    """
    from gsedit.words.read import read_instruction

    if not sentence.strip():
        raise UsageError("the sentence is empty: say what should change, as in 'make it snow'")
    read = read_instruction(sentence)
    text = "\n".join(map(str, read.changes)) if read.known else f"refused: {read.why}"
    print_result(json.loads(read.as_json()), text, as_json=as_json)


def list_settings(verb: str, *, as_json: bool) -> None:
    """Print the name, the default and the meaning of every setting of a verb."""
    from .capture import capture_settings
    from .edit import all_settings
    from .fit import fit_settings
    from .render import render_settings
    from .style import style_settings

    known = {
        "edit": all_settings, "fit": fit_settings, "render": render_settings,
        "style": style_settings, "capture": capture_settings,
    }  # fmt: skip
    if verb not in known:
        raise UsageError(f"{verb} has no settings: name one of {', '.join(known)}")
    for setting in known[verb]():
        name, default = ".".join(setting.path), setting.default
        record = {
            "name": name, "flag": setting.flag, "default": default, "meaning": setting.meaning,
        }  # fmt: skip
        value = f" [{default}]" if default else ""
        print_result(record, f"{name}{value}\n    {setting.meaning}", as_json=as_json)
