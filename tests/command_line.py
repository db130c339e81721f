"""Running `gsedit` in a test, and ending its long work early."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from gsedit_cli import main as cli
from typer.main import get_command
from typer.testing import CliRunner

from gsedit import Checkpoint, Event

FIT = ("--steps", 16, "--max-gaussians", 300, "--checkpoint-every", 0)
"""Options of a fit of half a second."""
EDIT = (
    "as bronze", "--editor", "closed-form", "--size", 32, "--batches", 1, "--views", 2,
    "--steps", 2, "--loss", "mse+gram", "--set", "checkpoint_seconds=0", "--set", "update_steps=4",
    "--set", "patch=16", "--set", "overlap=1", "--set", "coverage=1",
)  # fmt: skip
"""Sentence and options of an edit of a second, whose update is in steps."""


@cache
def program() -> Any:
    """The whole command, which keeps the options of each verb once they are made."""
    made = get_command(cli.app)
    for verb in made.commands.values():
        verb.make = cache(verb.make)
    return made


def gsedit(*words: object):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", lambda _: program())
        done = CliRunner().invoke(cli.app, [str(word) for word in words])
    if "--help-all" in words:  # which shows what was hidden, for good
        program.cache_clear()
    return done


def answer(*words: object) -> dict[str, Any]:
    """Run a command that must succeed; return the last line of what it prints with --json."""
    done = gsedit(*words, "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def files(folder: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def names(folder: Path) -> set[str]:
    """Return the places of all files, relative to the folder."""
    return {path.relative_to(folder).as_posix() for path in files(folder)}


def one_line(text: str) -> bool:
    return text.count("\n") == 1 and text.endswith("\n")


@contextmanager
def ended_early(work: str, end: BaseException, checkpoints: int = 1) -> Iterator[None]:
    """End every "fit" or "edit" inside by an exception, after so many checkpoints."""
    # not by dotted name: gsedit.fit is also the function of that name
    module = import_module(
        {"fit": "gsedit.capture.fitting.fit", "edit": "gsedit.editing.edit"}[work]
    )
    whole = getattr(module, f"{work}_steps")

    def steps(*words: Any, **options: Any) -> Iterator[Any]:
        kept = 0
        for item in whole(*words, **options):
            if kept == checkpoints:
                raise end
            yield item
            kept += isinstance(item, Checkpoint)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, f"{work}_steps", steps)
        yield


def read_events(path: Path) -> list[Event]:
    """The events of a metrics.jsonl."""
    return [Event(**json.loads(line)) for line in path.read_text().splitlines()]
