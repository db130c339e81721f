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
    """Return the values of a verb's options, a saved selection's name in --region as its file.

    Raises UsageError for a text that is neither a region nor a saved name, where there are names;
    InputError for a name saved for other Gaussians.
    """
    scene, text = current_scene.get(), values.get("region")
    if scene is None or not isinstance(text, str):
        return values
    from gsedit.select.saved import read_named, saved_file

    if (file := saved_file(scene, text)) is None:
        check_region(text, scene)
        return values
    from gsedit.formats.scenes import load  # which loads torch

    read_named(file, load(scene, drop_invalid=True).means.numpy())
    return {**values, "region": str(file)}


def check_region(text: str, scene: Path) -> None:
    """Raise UsageError for a text that is no region, with the names that there are."""
    from gsedit.select.saved import saved_names
    from gsedit.select.where import check_region as check_text

    try:
        check_text(text)
    except UsageError as error:
        if names := saved_names(scene):
            raise UsageError(f"{error}; or a name saved for {scene}: {', '.join(names)}") from None
        raise
