"""Cameras that move with a scene."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsedit.files.similarity import Similarity
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
