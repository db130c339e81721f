"""edit.json: what was asked of an edit, and what was measured of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsedit.run.json_files import list_of, object_of, read_json, text

_TEXTS = ("scene", "first_scene")
_OBJECTS = ("editor", "strategy", "measured", "timings", "work")
_RECORD = object_of(
    {},
    {
        **dict.fromkeys(_TEXTS, text()),
        **dict.fromkeys(_OBJECTS, object_of({})),
        "instruction": text(1 << 20, empty=True),
        "history": list_of(object_of({})),
        "edited_views": list_of(text()),
    },
)


def read_edit_record(path: Path) -> dict[str, Any]:
    """The object of an edit.json; keys that are null are left out. Raises InputError."""
    return read_json(path, _RECORD, advice="write it again, or remove it")
