"""The scene of the command that runs, and the selections saved for it in the place of a region."""

from __future__ import annotations

from contextvars import ContextVar
from pathlib import Path
from typing import Any

from gsedit.errors import UsageError

current_scene: ContextVar[Path | None] = ContextVar("current_scene", default=None)
"""SCENE of the command that runs, for options that need the cameras beside it; None once an
operation has moved the scene away from them."""


def with_saved_regions(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a verb's options with the name in --region as the path of its file.

    Raises UsageError for a text that is neither a region nor a saved name, where there are names.
    """
    text, scene = values.get("region"), current_scene.get()
    if not isinstance(text, str) or scene is None:
        return values
    from gsedit.regions.parse import parse_region
    from gsedit.regions.saved import saved_file, saved_names

    if file := saved_file(scene, text):
        return {**values, "region": str(file)}
    try:
        parse_region(text)
    except UsageError as error:
        if names := saved_names(scene):
            raise UsageError(f"{error}; or a name saved for {scene}: {', '.join(names)}") from None
        raise
    return values
