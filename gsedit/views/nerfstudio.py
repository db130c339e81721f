"""nerfstudio's transforms.json: camera-to-world matrices in OpenGL axes (y up, z back).

Also Blender-style files: camera_angle_x instead of the focal length, photos named without their
suffix, no sizes. Axes and keys: nerfstudio documentation, "Data conventions"."""

from __future__ import annotations

import os
from math import tan
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsedit.errors import InputError
from gsedit.formats.limits import MAX_COEFFICIENT, MAX_POSITION, MAX_SIDE, check_lens
from gsedit.formats.pictures import picture_size
from gsedit.run.inputs import file_inside, refuse_doubles, safe_name
from gsedit.run.json_files import list_of, number, numbers, object_of, read_json, text
from gsedit.views.colmap import read_colmap_points
from gsedit.views.export_frame import applied_by
from gsedit.views.photos import (
    Capture,
    PosedPhoto,
    SparsePoints,
    find_mask,
    find_photo,
    read_points,
    reduction,
)
from gsedit.views.undistort import ColmapLens, Lens
from rasterizer.camera import pose_of

_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_FISHEYE = ("OPENCV_FISHEYE", "FISHEYE")
_RATIONAL = "FULL_OPENCV"
_OTHER = {
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    _RATIONAL: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Parameters behind fx, fy, cx and cy, in COLMAP's order."""
_POINTS = ("sparse_pc.ply", "points3D.ply", "points3d.ply")
_COEFFICIENTS = (*(f"k{i}" for i in range(1, 7)), "p1", "p2")
_LENS = {
    **dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y"), number()),
    **dict.fromkeys(("w", "h"), number(1.0, float(MAX_SIDE))),
    **dict.fromkeys(_COEFFICIENTS, number(-MAX_COEFFICIENT, MAX_COEFFICIENT)),
    "camera_model": text(),
}
"""Keys that stand in a frame, or beside "frames" for all."""
_FRAME = object_of(
    {"file_path": text(), "transform_matrix": numbers(4, 4, most=MAX_POSITION)},
    {**_LENS, "mask_path": text(empty=True), "near": number(0.0)},
)
TRANSFORMS = object_of({"frames": list_of(_FRAME)}, {**_LENS, "ply_file_path": text(empty=True)})
"""A transforms.json, or a list of views."""


def read_nerfstudio(path: Path) -> Capture:
    """All photos of a transforms.json, and its sparse points. Raises InputError."""
    path = Path(path)
    record = read_json(path, TRANSFORMS)
    frames = record["frames"]
    photos, missing = [], []
    for i, frame in enumerate(frames):
        found = _photo(path, record, i, frame)
        (missing if isinstance(found, str) else photos).append(found)
    refuse_doubles((photo.name for photo in photos), f"{path}: two frames")
    photos.sort(key=lambda photo: photo.name)
    return Capture(tuple(photos), tuple(sorted(missing)), _points(path, record))


def _photo(
    path: Path, record: dict[str, Any], index: int, frame: dict[str, Any]
) -> PosedPhoto | str:
    """Its file_path where the file is not there."""
    file_path = frame["file_path"]
    where = f"{path}: frames[{index}] ({file_path})"
    values = {**record, **frame}
    pose = world_to_camera(frame["transform_matrix"], where)
    file = find_photo(path.parent, file_path, where)
    if file is None:
        return file_path
    name = safe_name(Path(os.path.relpath(file, path.parent)).as_posix(), where)
    mask = _mask(path.parent, frame.get("mask_path"), name, where)
    lens = _lens(values, file, reduction(file_path, name), where)
    return PosedPhoto(name, file, pose, lens, mask)


def _mask(folder: Path, named: str | None, name: str, where: str) -> Path | None:
    """The file of mask_path, or else one in masks/ that is named after the photo."""
    if named:
        file = file_inside(folder, named, where)
        if not file.is_file():
            raise InputError(
                f"{where}: mask_path {named} does not exist: copy it there or remove mask_path"
            )
        return file
    inner = name.partition("/")[2] or name  # images/a.jpg: masks/a.jpg.png
    return find_mask(folder / "masks", inner)


def world_to_camera(matrix: Float64[np.ndarray, "4 4"], where: str) -> Float[Tensor, "4 4"]:
    """The pose of a transform_matrix: flip the y and z axes of the camera, then invert the rigid
    motion by transposing. Raises InputError for a matrix that is no rigid motion."""
    pose, identity = torch.from_numpy(matrix), torch.eye(4, dtype=torch.float64)
    error = (pose[:3, :3].T @ pose[:3, :3] - identity[:3, :3]).abs().max()
    error = error.maximum((pose[3] - identity[3]).abs().max())
    # rounding to six decimals stays below 1e-5, a scaled pose does not
    if error > 1e-4 or pose[:3, :3].det() < 0:
        raise InputError(
            f"{where}: transform_matrix is no rigid motion (a rotation, a translation, 0 0 0 1): "
            "correct it or remove the frame"
        )
    rotation = pose[:3, :3] * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    return pose_of(rotation.T, pose[:3, 3])


def _lens(values: dict[str, Any], file: Path, reduced: int, where: str) -> Lens:
    """Intrinsics of one frame: its own keys come before the file's. `reduced`: how many times
    smaller the photo is than the one that is listed."""
    model = _model(values, where)

    number = values.get
    width, height = _calibrated_size(values, file, reduced, where)
    fx = number("fl_x") or _focal(number("camera_angle_x"), width)
    fy = number("fl_y") or _focal(number("camera_angle_y"), height) or fx
    fx = fx or fy
    if not fx or not fy:
        raise InputError(f"{where}: no focal length: add fl_x, w and h")
    width, height = int(width), int(height)
    cx, cy = number("cx", width / 2), number("cy", height / 2)
    check_lens((fx, fy), (cx, cy), (width, height), where)
    if model in _OTHER:
        params = (fx, fy, cx, cy, *(number(key) or 0.0 for key in _OTHER[model]))
        other = ColmapLens(model, params, width, height)
        return Lens(fx, fy, cx, cy, width, height, other)
    if number("k4"):
        # a fourth polynomial term in nerfstudio, a denominator in OpenCV: nobody undoes it there
        raise InputError(
            f"{where}: k4 has two meanings: set camera_model to FULL_OPENCV where it is OpenCV's "
            "rational model, to OPENCV_FISHEYE where the lens is a fisheye, or run "
            "`colmap image_undistorter` first"
        )
    coefficients = (number(key) or 0.0 for key in ("k1", "k2", "p1", "p2", "k3"))
    return Lens(fx, fy, cx, cy, width, height).bent(*coefficients)


def _calibrated_size(
    values: dict[str, Any], file: Path, reduced: int, where: str
) -> tuple[float, float]:
    """(width, height) that the intrinsics are for: w and h, else of the photo that is listed."""
    number = values.get
    width, height = number("w"), number("h")
    if width is not None and height is not None:
        return width, height
    width, height = (float(reduced * side) for side in picture_size(file))
    cx, cy = number("cx") or 0.0, number("cy") or 0.0
    if cx >= width or cy >= height:
        raise InputError(
            f"{where}: cx, cy ({cx:g}, {cy:g}) are outside of its {width:.0f}x{height:.0f} pixels, "
            "and w and h are missing: add those of the photos that were calibrated"
        )
    return width, height


def _model(values: dict[str, Any], where: str) -> str:
    """Camera model as COLMAP names it; OPENCV stands for all of its special cases."""
    model = values.get("camera_model", "OPENCV").upper()
    if values.get("is_fisheye") or model in _FISHEYE:
        return "OPENCV_FISHEYE"
    if model == _RATIONAL or any(values.get(key) for key in ("k5", "k6")):
        return _RATIONAL
    if model not in _PERSPECTIVE:
        move = "run `colmap image_undistorter` and load its folder"
        raise InputError(f"{where}: camera model {model} is not supported: {move}")
    return "OPENCV"


def _focal(angle: float | None, side: float) -> float | None:
    """The focal length, pixels, of a field of view in radians; None where there is none."""
    return side / 2 / tan(angle / 2) if angle and abs(angle) > 1e-9 else None


def _points(path: Path, record: dict[str, Any]) -> SparsePoints | None:
    """From the file that is named or lies beside, which is in the frame of the poses; or from the
    reconstruction in colmap/, to which the poses say what was applied."""
    if named := record.get("ply_file_path"):
        return read_points(file_inside(path.parent, named, f"{path}: ply_file_path"))
    beside = (path.parent / name for name in _POINTS)
    file = next((file for file in beside if file.is_file()), None)
    if file is not None:
        return read_points(file)
    model = path.parent / "colmap" / "sparse" / "0"
    if not any((model / f"points3D.{end}").is_file() for end in ("bin", "txt")):
        return None
    points = read_colmap_points(model)
    if points is None:
        return None
    turned, factor = applied_by(path)
    return points._replace(xyz=torch.from_numpy(turned.points(points.xyz.numpy()) * factor))
