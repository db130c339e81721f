"""Lists of views as JSON: the cameras of a measurement, so that two people measure the same.

The keys are nerfstudio's (transforms.json): each of "frames" has a file_path (the view's name), a
transform_matrix (camera to world, OpenGL axes: y up, z back; world units of the scene), fl_x, fl_y,
cx, cy, w and h in pixels. A "role" is added: "edited", "held_out" or "other" (see
gsedit.views.view_list); a frame without one is "held_out". Keys that all frames share may stand
beside "frames". Photos need not exist; lenses with distortion are refused.
"""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import Any

import torch

from gsedit.errors import InputError
from gsedit.files.atomic import atomic_path
from gsedit.files.inputs import existing_file
from gsedit.files.nerfstudio import parse_object, world_to_camera
from gsedit.views.view_list import ROLES, ViewList
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera

NAME = "views.json"
FORMAT = "gsedit views 1"
_LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


def write_view_list(views: ViewList, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a list of views, a line a view. Numbers are written to the last bit. Raises UsageError
    as `atomic_path` does."""
    frames = ",\n".join(
        json.dumps(_frame(viewpoint, role), allow_nan=False)
        for viewpoint, role in zip(views.viewpoints, views.roles)
    )
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(f'{{"format": "{FORMAT}", "frames": [\n{frames}\n]}}\n')


def read_view_list(path: str | Path) -> ViewList:
    """Views in the order of the file. Raises InputError, with the number of the frame."""
    path = existing_file(path)
    record = parse_object(path)
    frames = record.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(
            f"{path} has no list of frames: write a list of views with gsedit metrics --save-views"
        )
    viewpoints, roles = [], []
    for index, frame in enumerate(frames):
        where = f"{path}: frame {index}"
        if not isinstance(frame, dict):
            raise InputError(f"{where} is no object: correct it or remove the frame")
        values = {**record, **frame}
        viewpoints.append(_viewpoint(values, where))
        role = values.get("role", "held_out")
        if role not in ROLES:
            raise InputError(f"{where}: role is {role!r}: give one of {', '.join(ROLES)}")
        roles.append(role)
    names = [viewpoint.name for viewpoint in viewpoints]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: two frames are named {twice!r}: give each its own file_path")
    return ViewList(tuple(viewpoints), tuple(roles))


def _frame(viewpoint: Viewpoint, role: str) -> dict[str, Any]:
    camera = viewpoint.camera
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = camera.rotation.detach().double().T * torch.tensor([1.0, -1.0, -1.0]).double()
    pose[:3, 3] = camera.centre.detach().double()
    return {
        "file_path": viewpoint.name,
        "role": role,
        "w": camera.width,
        "h": camera.height,
        **{
            key: float(value)
            for key, value in zip(_LENS, (camera.fx, camera.fy, camera.cx, camera.cy))
        },
        "transform_matrix": pose.tolist(),
    }


def _viewpoint(values: dict[str, Any], where: str) -> Viewpoint:
    name = values.get("file_path")
    if not isinstance(name, str) or not name:
        raise InputError(f"{where} has no file_path: name the view")
    where = f"{where} ({name})"
    lens = {key: _number(values, key, where) for key in _LENS}
    if min(lens["fl_x"], lens["fl_y"]) <= 0 or min(lens["w"], lens["h"]) < 1:
        raise InputError(f"{where}: fl_x, fl_y, w or h is not positive: correct it")
    if any(values.get(key) for key in _DISTORTION):
        raise InputError(
            f"{where}: the lens has distortion, and a list of views has none: use the photos as "
            "--data and write the list with --save-views"
        )
    camera = Camera(
        world_to_camera(values.get("transform_matrix"), where),
        lens["fl_x"],
        lens["fl_y"],
        lens["cx"],
        lens["cy"],
        int(lens["w"]),
        int(lens["h"]),
    )
    return Viewpoint(name, camera)


def _number(values: dict[str, Any], key: str, where: str) -> float:
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise InputError(f"{where}: {key} is {value!r}, not a number: write it in pixels")
    return float(value)
