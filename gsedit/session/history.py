"""Edits of edits: what edit.json says of those that came before."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from gsedit.errors import InputError


def history_of(scene: Path) -> dict[str, Any]:
    """`first_scene` (its path) and `history` (a record of each earlier edit, the first one first)
    of an edit of this scene file: from the edit.json beside it, if the scene came from an edit.

    Raises InputError for an edit.json that cannot be read.
    """
    path = scene.with_name("edit.json")
    if scene.name != "scene.ply" or not path.is_file():
        return {"first_scene": scene, "history": []}
    try:
        earlier = json.loads(path.read_text(encoding="utf-8"))
        return {
            "first_scene": earlier.get("first_scene") or earlier.get("scene"),
            "history": [*earlier.get("history", []), _summary(earlier)],
        }
    except (ValueError, AttributeError, OSError) as error:
        raise InputError(
            f"{path} cannot be read ({error}): mend or remove it; {scene} is then edited without "
            "a history"
        ) from None


def _summary(record: dict[str, Any]) -> dict[str, Any]:
    """What identifies an edit, and the numbers that were measured of it."""
    decided = {name: record.get(name) for name in ("settings", "strategy", "editor", "seed")}
    text = json.dumps(decided, sort_keys=True)
    editor, strategy = (record.get(name) or {} for name in ("editor", "strategy"))
    measured = (record.get("measured") or {}).items()
    return {
        "instruction": record.get("instruction"),
        "editor": editor.get("editor"),
        "strategy": strategy.get("name"),
        "settings_digest": hashlib.sha256(text.encode()).hexdigest()[:16],
        "measured": {name: value for name, value in measured if isinstance(value, int | float)},
    }
