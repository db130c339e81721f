"""The scene of the command that runs, and the selections saved for it in the place of a region."""

from __future__ import annotations

from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

current_scene: ContextVar[Path | None] = ContextVar("current_scene", default=None)
"""SCENE of the command that runs, for options that need the cameras beside it; None once an
operation has moved the scene away from them."""


def with_saved_regions(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a verb's options with names of saved selections as what they stand for.

    In --region and --cage that is the path of the file, in --handle and --hold the middle of what
    is selected. Raises UsageError for a region that is neither a region nor a saved name, where
    there are names; InputError for a name saved for other Gaussians.
    """
    scene = current_scene.get()
    if scene is None:
        return values
    from gsedit.select.saved import read_named, saved_file

    told = dict(values)
    for option in ("region", "cage"):
        text = values.get(option)
        if isinstance(text, str) and (file := saved_file(scene, text)):
            read_named(file, means_of(scene))
            told[option] = str(file)
        elif isinstance(text, str) and option == "region":
            check_region(text, scene)
    for option, commas in (("handle", 2), ("hold", 0)):
        if texts := values.get(option):
            told[option] = [with_middle(text, commas, scene) for text in texts]
    return told


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


def with_middle(text: str, commas: int, scene: Path) -> str:
    """Return a handle with the middle of what is selected for a saved name, which stands before a
    part with so many commas."""
    from gsedit.select.saved import read_named, saved_file

    name, _, rest = text.partition(":")
    is_named = rest.partition(":")[0].count(",") == commas
    file = saved_file(scene, name) if is_named else None
    if file is None:
        return text
    means = means_of(scene)
    inside = read_named(file, means)
    if not inside.any():
        raise UsageError(f"{file} selects nothing: no handle can be there")
    x, y, z = means[inside].astype(float).mean(0)
    return ":".join([f"{x},{y},{z}", *([rest] if rest else [])])


def means_of(scene: Path) -> Float[np.ndarray, "n 3"]:
    """Return the centers of a scene file's Gaussians, without invalid rows."""
    from gsedit.formats.scenes import load

    return load(scene, drop_invalid=True).means.numpy()
