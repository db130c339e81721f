"""`gsedit doctor`: whether a model's weights are whole."""

from __future__ import annotations

from typing import Annotated

import typer

from ..core.command import argument
from ..core.console import print_result
from ..core.exits import UNREADABLE

Model = Annotated[
    str,
    argument("MODEL", "A folder of a 2D model's weights, or a Hugging Face id in the local cache."),
]


def doctor(model: Model) -> None:
    """Check the weights of a model.

    gsedit doctor models/instruct-pix2pix

    Prints what of them is there; the exit code is 3 if they are incomplete.
    """
    from gsedit.paper.models.hub import INDEX, family_of, find, inspect, settings_in

    folder = find(model, offline=True)
    parts = inspect(folder)
    kind = family_of(settings_in(folder / INDEX), folder).title
    problems = sum(bool(part.problem) for part in parts)
    lines = []
    for part in parts:
        held = f"{part.size / 1e6:,.1f} MB in {len(part.files)} files" if part.files else "here"
        copy = f", {part.stored}" if part.stored else ""
        lines.append(f"{part.name:<16} {'INCOMPLETE' if part.problem else held + copy}")
        lines += [f"{'':<16} -> {part.problem}"] * bool(part.problem)
    state = f"incomplete, {problems} problems" if problems else "complete"
    record = {"folder": folder, "complete": not problems, "kind": kind, "parts": parts}
    print_result(record, "\n".join([*lines, f"{folder}: {kind}, {state}"]))
    if problems:
        raise typer.Exit(UNREADABLE)
