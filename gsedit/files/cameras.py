"""cameras.json: the cameras of a capture beside its scene, in the format of INRIA's trainer.

A list of objects: id, img_name, width, height (pixels), position (the camera's centre), rotation
(camera to world, 3x3, rows; OpenCV axes), fx, fy (pixels). The principal point is the middle of the
picture. Source: `camera_to_JSON` of graphdeco-inria/gaussian-splatting, utils/camera_utils.py.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.atomic import atomic_path
from gsedit.files.inputs import beside, existing_file
from gsedit.views.dataset import View
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera

NAME = "cameras.json"
_ORTHONORMAL = 1e-3  # of R^T R: other writers round to float32 or to a few decimals


def cameras_file(scene: str | Path) -> Path | None:
    """The cameras of a scene file: SCENE.cameras.json or cameras.json beside it, or the one that
    INRIA's trainer leaves two folders above point_cloud/iteration_N/point_cloud.ply; else None.
    """
    scene = Path(scene)
    places = [own_file(scene), scene.with_name(NAME)]
    folder = scene.absolute().parent
    if folder.name.startswith("iteration_"):
        places.append(folder.parents[1] / NAME)
    return next((place for place in places if place.is_file()), None)


def own_file(scene: Path) -> Path:
    """bear.cameras.json of bear.ply: where cameras.json belongs to another scene."""
    return beside(scene, NAME)


def read_cameras(path: str | Path) -> tuple[Viewpoint, ...]:
    """All cameras of a cameras.json, sorted by name, as the photos of a dataset are.

    INRIA's trainer lists its held-out cameras first. Raises InputError, with the entry's number.
    """
    path = existing_file(path)
    try:
        record = json.loads(path.read_bytes())
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
        record = None
    if not isinstance(record, list) or not record:
        raise InputError(f"{path} is no list of cameras: remove it, or write it again")
    viewpoints = [_viewpoint(entry, f"{path}: entry {i}") for i, entry in enumerate(record)]
    return tuple(sorted(viewpoints, key=lambda viewpoint: viewpoint.name))


def write_cameras(
    viewpoints: Sequence[View | Viewpoint], path: str | Path, *, overwrite: bool = False
) -> None:
    """Write a cameras.json. The principal point is not part of the format."""
    entries = [_entry(i, viewpoint) for i, viewpoint in enumerate(viewpoints)]
    with atomic_path(path, overwrite=overwrite) as temporary:
        lines = ",\n".join(json.dumps(entry, allow_nan=False) for entry in entries)
        temporary.write_text(f"[{lines}]\n")


def write_beside(scene: str | Path, viewpoints: Sequence[View | Viewpoint]) -> Path:
    """Write the cameras that a scene was fitted to beside it; the path of the file.

    A cameras.json with other poses may belong to another scene in the folder: it is left as it is,
    and the file is SCENE.cameras.json, which `cameras_file` prefers.
    """
    scene = Path(scene)
    path, own = scene.with_name(NAME), own_file(scene)
    if own.exists() or (path.exists() and not _same_poses(path, viewpoints)):
        path = own
    write_cameras(viewpoints, path, overwrite=True)
    return path


def _same_poses(path: Path, viewpoints: Sequence[View | Viewpoint]) -> bool:
    try:
        found = read_cameras(path)
    except InputError:
        return False
    ordered = sorted(viewpoints, key=lambda viewpoint: viewpoint.name)
    return len(found) == len(ordered) and all(
        a.name == b.name
        and torch.allclose(
            a.camera.world_to_camera, b.camera.world_to_camera.double(), rtol=1e-5, atol=1e-6
        )
        for a, b in zip(found, ordered)
    )


def _entry(index: int, viewpoint: View | Viewpoint) -> dict[str, Any]:
    camera = viewpoint.camera
    return {
        "id": index,
        "img_name": viewpoint.name,
        "width": camera.width,
        "height": camera.height,
        "position": camera.centre.detach().tolist(),
        "rotation": camera.rotation.detach().T.tolist(),
        "fy": float(camera.fy),
        "fx": float(camera.fx),
    }


def _viewpoint(entry: Any, where: str) -> Viewpoint:
    try:
        position = _numbers(entry["position"], (3,))
        rotation = _numbers(entry["rotation"], (3, 3))
        fx, fy = float(entry["fx"]), float(entry["fy"])
        width, height = int(entry["width"]), int(entry["height"])
        name = str(entry["img_name"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where} lacks a key of INRIA's format, or its value has another shape ({error}): "
            "write the file again, or remove it"
        ) from None
    gram = rotation.T @ rotation - torch.eye(3, dtype=torch.float64)
    if gram.abs().max() > _ORTHONORMAL or rotation.det() < 0:
        raise InputError(f"{where}: rotation is none: correct it, or remove the file")
    if not (0 < fx < float("inf") and 0 < fy < float("inf")) or min(width, height) < 1:
        raise InputError(f"{where}: fx, fy, width or height is not positive: correct it")
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ position
    return Viewpoint(name, Camera(pose, fx, fy, width / 2, height / 2, width, height))


def _numbers(value: Any, shape: tuple[int, ...]) -> Float[Tensor, "..."]:
    tensor = torch.tensor(value, dtype=torch.float64)
    if tuple(tensor.shape) != shape or not tensor.isfinite().all():
        raise ValueError(f"{list(shape)} finite numbers are needed")
    return tensor
