"""Checks of what `gsedit edit` is asked, before any file is read."""

from __future__ import annotations

import os
from pathlib import Path

from gsedit.errors import UsageError

from .cameras import ViewOptions
from .editing import EditorOptions
from .routes import read_sentence
from .settings import Values


def check_request(instruction: str, views: ViewOptions, out: Path | None, explain: bool) -> Path:
    """Return the folder for the results. Raises UsageError before any file is read."""
    if not instruction.strip():
        raise UsageError("the instruction is empty: say what should change, as in 'make it snow'")
    views.check()
    if explain:
        return out or Path()
    if out is None:
        raise UsageError("-o is missing: name a folder for the results, or add --explain")
    return out


def check_apart(scene: Path, out: Path) -> None:
    """Raise UsageError where the results would replace the scene that is edited."""
    if os.path.realpath(scene) == os.path.realpath(out / "scene.ply"):
        raise UsageError(f"-o {out} is the folder of the scene that is edited: name another folder")


def check_condition(condition: str, data: Path | None) -> None:
    """Raise UsageError where the editor needs photos and there are none."""
    if condition == "photo" and data is None:
        raise UsageError("--condition photo shows the editor the photos: name them with --data")


def check_click(instruction: str, editor: EditorOptions, values: Values, scene: Path) -> None:
    """Raise UsageError, before a file is read, where --at cannot be heeded."""
    steps = read_sentence(instruction, editor, values, scene)
    if steps is not None and len(steps) > 1:
        raise UsageError(
            f"--at points into one scene, and this takes {len(steps)} edits: ask for each alone"
        )
