"""`gsedit doctor`: what this machine lacks, and whether a model's weights are whole."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from ..core.command import argument
from ..core.console import as_json, print_message, print_result
from ..core.exits import UNREADABLE

Model = Annotated[
    str | None,
    argument("MODEL", "A folder of a 2D model's weights, or a Hugging Face id in the local cache."),
]


def doctor(model: Model = None) -> None:
    """Check this machine, or the weights of a model.

    gsedit doctor models/instruct-pix2pix

    Without MODEL: libraries, torch and the compiler; the exit code is 0 whatever is missing. With
    MODEL, the exit code is 3 if its weights are incomplete.
    """
    if model is None:
        check_machine()
    else:
        check_weights(model)


def check_machine() -> None:
    """Print a line a check, with advice below it."""
    from gsedit.doctor import check_machine

    if not as_json.get():
        print_message("checking libraries, torch and the compiler: a few seconds")
    problems = 0
    for check in check_machine():
        problems += bool(check.advice)
        advice = f"\n{'':<16} -> {check.advice}" if check.advice else ""
        print_result(asdict(check), f"{check.name:<16} {check.state}{advice}")
    if not as_json.get():
        counted = f"{problems} problem{'s' if problems > 1 else ''}, marked ->"
        print_message(counted if problems else "no problems")


def check_weights(model: str) -> None:
    """Print what of a model's weights is there. Exits with UNREADABLE unless all of it is."""
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
