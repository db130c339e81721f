"""Flags in a file in the place of a region: what is clicked, and what each step of an edit has."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import GseditError, UsageError

from ..core.console import print_message
from .cameras import ViewOptions
from .pointing import AtOptions, views_to_point_at
from .settings import Values

if TYPE_CHECKING:
    from rasterizer.scene import Gaussians

NAME = "at.npy"
"""File of the flags, in the folder of the edit."""


@contextmanager
def region_at(
    pointing: AtOptions,
    values: Values,
    scene: Path,
    load: Callable[[], Gaussians],
    views: ViewOptions,
    folder: Path | None,
) -> Iterator[Values]:
    """Yield the settings of an edit with what --at points at as their region.

    Its flags are in the folder (None: in a temporary one), and go with it where the edit fails.
    Raises UsageError for --region beside it, and where nothing is there.
    """
    if not pointing.at:
        yield values
        return
    if ("region",) in values:
        raise UsageError("--at and --region both say where: leave one out")
    pointing.check()
    from gsedit.regions.region import save_region

    gaussians = load()
    found = pointing.clicked(gaussians, views_to_point_at(scene, gaussians, views))
    print_message(f"at: {found}")
    with tempfile.TemporaryDirectory() as temporary:
        file = (folder or Path(temporary)) / NAME
        save_region(found, file, overwrite=True)
        try:
            yield {**values, ("region",): str(file)}
        except GseditError:
            file.unlink(missing_ok=True)
            with suppress(OSError):
                file.parent.rmdir()
            raise


def own_region(values: Values, first: Path, scene: Path) -> Values:
    """Return the settings of a step of an edit with its own flags of a saved selection.

    `first` is the scene before all steps, that the region of the settings was saved for.
    """
    from gsedit.regions.saved import folder_of

    region = Path(str(values.get(("region",), "")))
    own = folder_of(scene) / region.name
    is_saved = region.parent == folder_of(first) and own.is_file()
    return {**values, ("region",): str(own)} if is_saved else values
