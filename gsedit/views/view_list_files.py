"""Lists of views as JSON: the cameras of a measurement, so that two people measure the same.

The keys are nerfstudio's (transforms.json): each of "frames" has a file_path (the view's name), a
transform_matrix (camera to world, OpenGL axes: y up, z back; world units of the scene), fl_x, fl_y,
cx, cy, w and h in pixels. A "role" is added (see `Role`; "held_out" in a frame without one), and
"near" (world units) where a camera has a near plane of its own. Keys that all frames share may
stand beside "frames". Photos need not exist; lenses with distortion are refused.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import torch

from gsedit.errors import InputError, UsageError
from gsedit.formats.limits import check_lens
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import refuse_doubles, safe_name
from gsedit.run.json_files import read_json
from gsedit.views.nerfstudio import TRANSFORMS, world_to_camera
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera

Role = Literal["edited", "held_out", "other"]
"""edited: the scene was fitted to pictures of this view. held_out: it was not, and is measured
here. other: neither; a neighbor, with which renders are compared."""
ROLES: tuple[Role, ...] = get_args(Role)
HELD_OUT_EVERY = 8
"""Step between held-out views of a capture of which nothing else is known, as in `Dataset.split`.
"""


@dataclass(frozen=True, eq=False)
class ViewList:
    """Named cameras, each with its role."""

    viewpoints: tuple[Viewpoint, ...]
    roles: tuple[Role, ...]

    def __len__(self) -> int:
        return len(self.viewpoints)

    def having(self, role: Role) -> tuple[int, ...]:
        """The indices of the views with that role."""
        return tuple(i for i, each in enumerate(self.roles) if each == role)


def by_capture(viewpoints: Sequence[Viewpoint]) -> ViewList:
    """Every 8th view held out, as `gsedit fit` and `gsedit edit` do, the others edited."""
    roles: list[Role] = [
        "edited" if i % HELD_OUT_EVERY else "held_out" for i in range(len(viewpoints))
    ]
    return ViewList(tuple(viewpoints), tuple(roles))


def by_edit(viewpoints: Sequence[Viewpoint], edited: Collection[str]) -> ViewList:
    """Views of an edit: `edited` names the views that were edited; every 8th view was held out,
    unless there was no other to be edited."""
    roles: list[Role] = []
    for role, viewpoint in zip(by_capture(viewpoints).roles, viewpoints):
        own: Role = "held_out" if role == "held_out" else "other"
        roles.append("edited" if viewpoint.name in edited else own)
    return ViewList(tuple(viewpoints), tuple(roles))


def with_roles_of(given: ViewList, views: ViewList) -> ViewList:
    """`views` with the roles that `given` gives to those names; "other" where it names none.

    Raises UsageError where it names none of them.
    """
    named: dict[str, Role] = {each.name: role for each, role in zip(given.viewpoints, given.roles)}
    roles: list[Role] = [named.get(viewpoint.name, "other") for viewpoint in views.viewpoints]
    if not any(viewpoint.name in named for viewpoint in views.viewpoints):
        raise UsageError(
            f"none of the listed views ({given.viewpoints[0].name}, ...) is one of these photos "
            f"({views.viewpoints[0].name}, ...): give the list that was made with them"
        )
    return ViewList(views.viewpoints, tuple(roles))


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
    path = Path(path)
    record = read_json(path, TRANSFORMS, advice="write it with gsedit metrics --save-views")
    frames = [{**record, **frame} for frame in record["frames"]]
    if not frames:
        raise InputError(
            f"{path} has no list of frames: write a list of views with gsedit metrics --save-views"
        )
    viewpoints = [_viewpoint(each, f"{path}: frames[{i}]") for i, each in enumerate(frames)]
    roles = [each.get("role", "held_out") for each in frames]
    for i, role in enumerate(roles):
        if role not in ROLES:
            names = ", ".join(ROLES)
            raise InputError(f"{path}: frames[{i}]: role is {role!r:.80}: give one of {names}")
    names = [viewpoint.name for viewpoint in viewpoints]
    refuse_doubles(names, f"{path}: two frames")
    return ViewList(tuple(viewpoints), tuple(roles))


def _frame(viewpoint: Viewpoint, role: str) -> dict[str, Any]:
    camera = viewpoint.camera
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = camera.rotation.detach().double().T * torch.tensor([1.0, -1.0, -1.0]).double()
    pose[:3, 3] = camera.center.detach().double()
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
        **({} if camera.near is None else {"near": camera.near}),
    }


def _viewpoint(values: dict[str, Any], where: str) -> Viewpoint:
    name = safe_name(values["file_path"], where)
    where = f"{where} ({name})"
    missing = next((key for key in _LENS if key not in values), None)
    if missing is not None:
        raise InputError(f"{where} has no {missing}: write it in pixels")
    fx, fy, cx, cy = (values[key] for key in _LENS[:4])
    width, height = (int(values[key]) for key in _LENS[4:])
    check_lens((fx, fy), (cx, cy), (width, height), where)
    if any(values.get(key) for key in _DISTORTION):
        raise InputError(
            f"{where}: the lens has distortion, and a list of views has none: use the photos as "
            "--data and write the list with --save-views"
        )
    pose = world_to_camera(values["transform_matrix"], where)
    return Viewpoint(name, Camera(pose, fx, fy, cx, cy, width, height, near=values.get("near")))
