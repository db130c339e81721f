"""`--region` as a selection: the forms of gsedit edit, on any verb that acts on a part."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.points.selection.base import EVERYTHING, Selection

from .console import print_message
from .options import current_scene

if TYPE_CHECKING:
    import numpy as np

    from gsedit.files.table import SplatTable


@dataclass(frozen=True)
class Subject(Selection):
    """The subject of an instruction, as `gsedit edit --region auto` finds it."""

    prompt: str
    scene: Path | None
    data: Path | None

    @property
    def whole(self) -> bool:
        return True

    @property
    def view_dependent(self) -> bool:
        return True

    def mask(self, table: SplatTable) -> np.ndarray:
        from gsedit.edit import find_region
        from gsedit.files.table import gaussians_of
        from rasterizer.numerics import AUTO

        from .cameras import ViewOptions, load_views

        gaussians = gaussians_of(table)
        dataset = load_views(self.scene, gaussians, ViewOptions(data=self.data), AUTO)
        found = find_region(gaussians, "auto", dataset=dataset, prompt=self.prompt)
        print_message(f"region: {found}")
        return found.inside.numpy()


def region_selection(text: str, data: Path | None, prompt: str | None) -> Selection:
    """What `--region` selects of the scene that the verb reads. Raises UsageError."""
    from gsedit.errors import UsageError
    from gsedit.points.selection import forms
    from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region

    spec = parse_region(text)
    if isinstance(spec, Auto) != bool((prompt or "").strip()):
        raise UsageError("--region auto and --prompt 'turn it into bronze' belong together")
    match spec:
        case All():
            return EVERYTHING
        case Box(low, high):
            return forms.box(*low, *high)
        case Sphere(centre, radius):
            return forms.sphere(*centre, radius)
        case File(path) if path.suffix.lower() == ".npy":
            return forms.flags(str(path))
        case File(path):
            from gsedit.points.selection.seen import Drawn

            return Drawn(path, recorded_cameras("--region", data), current_scene.get())
    return Subject(prompt or "", current_scene.get(), data)


def recorded_cameras(flag: str, data: Path | None) -> Path:
    """--data, or the cameras.json beside the scene. Raises UsageError where there is neither."""
    from gsedit.errors import UsageError
    from gsedit.files.cameras import cameras_file

    scene = current_scene.get()
    cameras = data or (cameras_file(scene) if scene else None)
    if cameras is None:
        raise UsageError(
            f"{flag} needs the cameras: add --data with the photos' folder or a cameras.json"
        )
    return cameras
