"""cameras.json: the cameras of a capture beside its scene, in the format of INRIA's trainer.

A list of objects: id, img_name, width, height (pixels), position (the camera's center), rotation
(camera to world, 3x3, rows; OpenCV axes), fx, fy (pixels); the principal point is the middle of the
picture. Where a camera has a near plane of its own, near (world units) is added. Source:
`camera_to_JSON` of graphdeco-inria/gaussian-splatting, utils/camera_utils.py.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from math import isclose
from pathlib import Path
from typing import Any

import torch

from gsedit.errors import InputError
from gsedit.formats.limits import MAX_POSITION, MAX_SIDE, check_lens
from gsedit.run.atomic import atomic_path, beside_or_shared
from gsedit.run.inputs import beside, safe_name
from gsedit.run.json_files import list_of, number, numbers, object_of, read_json, text
from gsedit.views.dataset import View
from gsedit.views.viewpoints import Viewpoint, same_size, that_see, thinned, viewpoints_near
from rasterizer.camera import Camera, pose_of
from rasterizer.scene import Gaussians

NAME = "cameras.json"
_CAMERAS = list_of(
    object_of(
        {
            "img_name": text(),
            "position": numbers(3, most=MAX_POSITION),
            "rotation": numbers(3, 3, most=2.0),
            **dict.fromkeys(("fx", "fy"), number()),
            **dict.fromkeys(("width", "height"), number(1.0, float(MAX_SIDE))),
        },
        {"near": number(0.0)},
    ),
    least=1,
)


def cameras_file(scene: str | Path) -> Path | None:
    """The cameras of a scene file: SCENE.cameras.json or cameras.json beside it, or the one that
    INRIA's trainer leaves two folders above point_cloud/iteration_N/point_cloud.ply; else None."""
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
    path = Path(path)
    entries = read_json(
        path, _CAMERAS, advice="write it again, or remove it: gsedit edit then finds views"
    )
    viewpoints = [_viewpoint(entry, f"{path}: [{i}]") for i, entry in enumerate(entries)]
    return tuple(sorted(viewpoints, key=lambda viewpoint: viewpoint.name))


def recorded_viewpoints(scene: Gaussians, file: Path | None, size: int) -> tuple[Viewpoint, ...]:
    """The viewpoints of a cameras.json on pictures `size` pixels wide, for a scene beside it; none
    if none of them sees the scene, or without a file."""
    if file is None:
        return ()
    found = viewpoints_near(same_size(read_cameras(file), size), scene)
    return found if any(that_see((each,), scene) for each in thinned(found, 16)) else ()


def write_cameras(
    viewpoints: Sequence[View | Viewpoint], path: str | Path, *, overwrite: bool = False
) -> None:
    """Write a cameras.json. The principal point is not part of the format."""
    entries = [_entry(i, viewpoint) for i, viewpoint in enumerate(viewpoints)]
    with atomic_path(path, overwrite=overwrite) as temporary:
        lines = ",\n".join(json.dumps(entry, allow_nan=False) for entry in entries)
        temporary.write_text(f"[{lines}]\n")


def write_beside(
    scene: str | Path, viewpoints: Sequence[View | Viewpoint], *, overwrite: bool = False
) -> Path:
    """Write the cameras that a scene was fitted to beside it; the path of the file.

    A cameras.json of other cameras may belong to another scene in the folder: it is left as it is,
    and the file is SCENE.cameras.json, which `cameras_file` prefers. Raises UsageError where that
    exists and holds other cameras, unless `overwrite`.
    """
    path = place_beside(scene, viewpoints, overwrite=overwrite)
    if not _same_cameras(viewpoints, path):
        write_cameras(viewpoints, path, overwrite=overwrite)
    return path


def place_beside(
    scene: str | Path, viewpoints: Sequence[View | Viewpoint], *, overwrite: bool = False
) -> Path:
    """Return where `write_beside` writes. Raises what it raises."""
    scene = Path(scene)
    fits = partial(_same_cameras, viewpoints)
    return beside_or_shared(own_file(scene), scene.with_name(NAME), fits, overwrite=overwrite)


def _same_cameras(viewpoints: Sequence[View | Viewpoint], path: Path) -> bool:
    """Whether a file has these names, poses and angles of view, at any size of the pictures."""
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
        and isclose(_angle(a.camera), _angle(b.camera), rel_tol=1e-3)
        for a, b in zip(found, ordered)
    )


def _angle(camera: Camera) -> float:
    """Return the focal length as a share of the picture's longer side."""
    return float(camera.fx if camera.width >= camera.height else camera.fy) / max(
        camera.width, camera.height
    )


def _entry(index: int, viewpoint: View | Viewpoint) -> dict[str, Any]:
    camera = viewpoint.camera
    return {
        "id": index,
        "img_name": viewpoint.name,
        "width": camera.width,
        "height": camera.height,
        "position": camera.center.detach().tolist(),
        "rotation": camera.rotation.detach().T.tolist(),
        "fy": float(camera.fy),
        "fx": float(camera.fx),
        **({} if camera.near is None else {"near": camera.near}),
    }


def _viewpoint(entry: dict[str, Any], where: str) -> Viewpoint:
    position, rotation = (torch.from_numpy(entry[key]) for key in ("position", "rotation"))
    gram = rotation.T @ rotation - torch.eye(3, dtype=torch.float64)
    if gram.abs().max() > 1e-3 or rotation.det() < 0:
        raise InputError(f"{where}: rotation is none: correct it, or remove the file")
    fx, fy, width, height = (entry[key] for key in ("fx", "fy", "width", "height"))
    width, height = int(width), int(height)
    check_lens((fx, fy), (width / 2, height / 2), (width, height), where)
    pose = pose_of(rotation.T, position)
    camera = Camera(pose, fx, fy, width / 2, height / 2, width, height, near=entry.get("near"))
    return Viewpoint(safe_name(entry["img_name"], where), camera)
