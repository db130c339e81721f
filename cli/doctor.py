"""`gsedit doctor`: what this machine lacks, and whether a model's weights are whole."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from .console import print_message, print_result
from .options import Common

if TYPE_CHECKING:
    from gsedit.editors.weights import Weights

INCOMPLETE = 3  # the code of an input that cannot be read


def doctor(
    model: Annotated[
        str | None,
        typer.Argument(
            metavar="[MODEL]",
            help="A folder of InstructPix2Pix weights, or a hub id in the local cache.",
            show_default=False,
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Check versions, threads, memory, compiler and viewers; with MODEL, its weights instead.

    gsedit doctor models/instruct-pix2pix

    Ends with 3 where the weights are not whole. What the machine lacks is advice, and ends with 0.
    """
    common.apply()
    if model is None:
        check_machine(as_json=common.json)
    else:
        check_weights(model, as_json=common.json)


def check_machine(*, as_json: bool) -> None:
    from gsedit.doctor import check_machine

    advised = 0
    for check in check_machine():
        advised += bool(check.advice)
        advice = f"\n{'':<16} -> {check.advice}" if check.advice else ""
        print_result(asdict(check), f"{check.name:<16} {check.found}{advice}", as_json=as_json)
    if not as_json:
        print_message(f"{advised} to look at" if advised else "all is well")


def check_weights(model: str, *, as_json: bool) -> None:
    from gsedit.editors.pix2pix import find
    from gsedit.editors.weights import inspect

    found = inspect(find(model, offline=True))
    record = {
        "folder": found.folder,
        "complete": found.complete,
        "kind": found.kind,
        "parts": list(found.parts),
        "notes": list(found.notes),
    }
    print_result(record, as_text(found), as_json=as_json)
    if not found.complete:
        raise typer.Exit(INCOMPLETE)


def as_text(found: Weights) -> str:
    """A line a part, its problems below it, and last the verdict."""
    lines = []
    for part in found.parts:
        held = f"{part.size / 1e6:,.1f} MB in {len(part.files)} files" if part.files else "here"
        copy = f", {part.variant} copy" if part.variant else ""
        lines.append(f"{part.name:<16} {'NOT WHOLE' if part.problems else held + copy}")
        lines += [f"{'':<16} -> {problem}" for problem in part.problems]
    lines += [f"{'note':<16} {note}" for note in found.notes]
    kind = f"InstructPix2Pix ({found.kind})" if found.kind else "a model"
    state = "complete" if found.complete else f"NOT complete, {len(found.problems)} problems"
    return "\n".join([*lines, f"{found.folder}: {kind}, {state}"])
