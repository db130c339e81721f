"""The cameras of a scene that was moved: its pictures stay, but are flipped if it is mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from gsedit.errors import UsageError
from gsedit.files.cameras import cameras_file, own_file, read_cameras, write_cameras
from gsedit.files.similarity import IDENTITY, Similarity
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera


def moved_camera(camera: Camera, similarity: Similarity) -> Camera:
    """The camera that sees the moved scene as `camera` sees the scene.

    No camera sees a mirrored scene the same way: this one sees the picture flipped, left for right.
    """
    rotation = camera.rotation.detach().double().numpy() @ similarity.turn.T
    centre = similarity.points(camera.centre.detach().double().numpy()[None])[0]
    cx = camera.cx
    if similarity.mirrors:
        rotation, cx = rotation * [[-1.0], [1.0], [1.0]], camera.width - camera.cx
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.from_numpy(rotation)
    pose[:3, 3] = torch.from_numpy(-rotation @ centre)
    return replace(camera, world_to_camera=pose, cx=cx)


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
        """Write the cameras after all operations that moved the scene and its cameras."""
        if self.output is None:
            return None
        whole = IDENTITY
        for each in operations:
            if getattr(each, "cameras", False):
                whole = each.moved.after(whole)
        moved = [Viewpoint(v.name, moved_camera(v.camera, whole)) for v in self.viewpoints]
        write_cameras(moved, self.output, overwrite=self.overwrite)
        return self.output
