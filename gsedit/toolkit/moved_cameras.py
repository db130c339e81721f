"""The cameras of a scene that was moved: its pictures stay, but are flipped if it is mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gsedit.datasets.cameras_json import cameras_file, own_file, read_cameras, write_cameras
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.errors import UsageError
from gsedit.scene.similarity import IDENTITY, moved_camera


class CameraMove:
    """The cameras beside a scene's file, read before it is worked on, written after."""

    def __init__(self, scene: Path, output: Path | None, overwrite: bool) -> None:
        """Raises UsageError if there are no cameras, or the file for the moved ones exists."""
        file = cameras_file(scene)
        if file is None:
            raise UsageError(f"{scene} has no cameras.json beside it: leave out --cameras")
        self.viewpoints = read_cameras(file)
        self.output = None if output is None else own_file(output)
        self.overwrite = overwrite
        if self.output is not None and self.output.exists() and not overwrite:
            raise UsageError(f"{self.output} exists: add -f to replace it")

    def write(self, operations: Sequence[Any]) -> Path | None:
        """Write the cameras where all operations that move the whole scene bring them."""
        if self.output is None:
            return None
        whole = IDENTITY
        for each in operations:
            if each.moves:
                whole = each.moved.after(whole)
        moved = [Viewpoint(v.name, moved_camera(v.camera, whole)) for v in self.viewpoints]
        write_cameras(moved, self.output, overwrite=self.overwrite)
        return self.output
