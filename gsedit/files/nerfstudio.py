"""nerfstudio's transforms.json: camera-to-world matrices in OpenGL axes (y up, z back).

Also Blender-style files: camera_angle_x instead of the focal length, photos named without their
suffix, no sizes. Axes and keys: nerfstudio documentation, "Data conventions"."""

from __future__ import annotations

import json
import os
from functools import partial
from math import isfinite, tan
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.colmap import read_colmap_points
from gsedit.files.dataparser import applied_by
from gsedit.files.inputs import existing_file, file_inside
from gsedit.files.photos import (
    Capture,
    PosedPhoto,
    SparsePoints,
    find_mask,
    find_photo,
    read_points,
    reduction,
)
from gsedit.files.pictures import picture_size
from gsedit.files.undistort import ColmapLens, Lens

_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_FISHEYE = ("OPENCV_FISHEYE", "FISHEYE")
_RATIONAL = "FULL_OPENCV"
_OTHER = {
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    _RATIONAL: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Parameters behind fx, fy, cx and cy, in COLMAP's order."""
_POINTS = ("sparse_pc.ply", "points3D.ply", "points3d.ply")
_ORTHONORMAL = 1e-4  # of R^T R: rounding to six decimals stays below 1e-5, a scaled pose does not


def read_nerfstudio(path: Path) -> Capture:
    """All photos of a transforms.json, and its sparse points. Raises InputError."""
    path = existing_file(path)
    record = parse_object(path)
    frames = record.get("frames")
    if not isinstance(frames, list):
        raise InputError(f"{path} has no list of frames: is it a transforms.json? Check the path")
    photos, missing = [], []
    for i, frame in enumerate(frames):
        found = _photo(path, record, i, frame)
        (missing if isinstance(found, str) else photos).append(found)
    photos.sort(key=lambda photo: photo.name)
    return Capture(tuple(photos), tuple(sorted(missing)), _points(path, record))


def parse_object(path: Path) -> dict[str, Any]:
    """The object that a transforms.json holds. Raises InputError, with the place."""
    try:
        record = json.loads(path.read_bytes())
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{path}: {place}: {error.msg}: repair it or copy it again") from None
    except (UnicodeDecodeError, RecursionError):
        raise InputError(f"{path} is not JSON text: check the path or copy it again") from None
    if not isinstance(record, dict):
        raise InputError(f"{path} is no transforms.json (no object at the top): check the path")
    return record


def _photo(path: Path, record: dict[str, Any], index: int, frame: Any) -> PosedPhoto | str:
    """Its file_path where the file is not there."""
    where = f"{path}: frame {index}"
    file_path = frame.get("file_path") if isinstance(frame, dict) else None
    if not isinstance(file_path, str) or not file_path:
        raise InputError(f"{where} has no file_path: add one or remove the frame")
    where = f"{where} ({file_path})"
    values = {**record, **frame}
    pose = world_to_camera(values.get("transform_matrix"), where)
    file = find_photo(path.parent, file_path, where)
    if file is None:
        return file_path
    name = Path(os.path.relpath(file, path.parent)).as_posix()
    mask = _mask(path.parent, frame.get("mask_path"), name, where)
    lens = _lens(values, file, reduction(file_path, name), where)
    return PosedPhoto(name, file, pose, lens, mask)


def _mask(folder: Path, named: Any, name: str, where: str) -> Path | None:
    """The file of mask_path, or else one in masks/ that is named after the photo."""
    if isinstance(named, str) and named:
        file = file_inside(folder, named, where)
        if not file.is_file():
            raise InputError(
                f"{where}: mask_path {named} does not exist: copy it there or remove mask_path"
            )
        return file
    inner = name.partition("/")[2] or name  # images/a.jpg: masks/a.jpg.png
    return find_mask(folder / "masks", inner)


def world_to_camera(matrix: Any, where: str) -> Float[Tensor, "4 4"]:
    """Flip the y and z axes of the camera, then invert the rigid motion by transposing."""
    try:
        pose = torch.tensor(matrix, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        pose = torch.zeros(0)
    problem = _pose_error(pose)
    if problem:
        raise InputError(f"{where}: transform_matrix {problem}: correct it or remove the frame")
    rotation = pose[:3, :3] * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    inverse = torch.eye(4, dtype=torch.float64)
    inverse[:3, :3] = rotation.T
    inverse[:3, 3] = -rotation.T @ pose[:3, 3]
    return inverse


def _pose_error(pose: Float[Tensor, "..."]) -> str:
    """What is wrong with a camera-to-world matrix; empty if nothing is."""
    if pose.shape != (4, 4):
        return "is not 4x4 numbers"
    if not pose.isfinite().all():
        return "is not finite"
    rotation, identity = pose[:3, :3], torch.eye(4, dtype=torch.float64)
    error = (rotation.T @ rotation - identity[:3, :3]).abs().max()
    if error > _ORTHONORMAL or rotation.det() < 0 or not torch.equal(pose[3], identity[3]):
        return "is no rigid motion (a rotation, a translation, 0 0 0 1)"
    return ""


def _lens(values: dict[str, Any], file: Path, reduced: int, where: str) -> Lens:
    """Intrinsics of one frame: its own keys come before the file's. `reduced`: how many times
    smaller the photo is than the one that is listed."""
    model = _model(values, where)

    number = partial(_number, values, where)
    width, height = _calibrated_size(values, file, reduced, where)
    fx = number("fl_x") or _focal(number("camera_angle_x"), width)
    fy = number("fl_y") or _focal(number("camera_angle_y"), height) or fx
    fx = fx or fy
    if not fx or not fy or min(fx, fy, width, height) <= 0:
        raise InputError(f"{where}: no positive focal length or size: add fl_x, w and h")
    width, height = int(width), int(height)
    cx, cy = number("cx"), number("cy")
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    if model in _OTHER:
        params = (fx, fy, cx, cy, *(number(key) or 0.0 for key in _OTHER[model]))
        other = ColmapLens(model, params, width, height)
        return Lens(fx, fy, cx, cy, width, height, other=other)
    if number("k4"):
        # a fourth polynomial term in nerfstudio, a denominator in OpenCV: nobody undoes it there
        raise InputError(
            f"{where}: k4 has two meanings: set camera_model to FULL_OPENCV where it is OpenCV's "
            "rational model, to OPENCV_FISHEYE where the lens is a fisheye, or run "
            "`colmap image_undistorter` first"
        )
    k1, k2, k3, p1, p2 = (number(key) or 0.0 for key in ("k1", "k2", "k3", "p1", "p2"))
    return Lens(fx, fy, cx, cy, width, height, k1, k2, k3, p1, p2)


def _number(values: dict[str, Any], where: str, key: str) -> float | None:
    """A finite number, None where there is none. Raises InputError for anything else."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise InputError(f"{where}: {key} is {value!r}, not a number: correct it")
    return float(value)


def _calibrated_size(
    values: dict[str, Any], file: Path, reduced: int, where: str
) -> tuple[float, float]:
    """(width, height) that the intrinsics are for: w and h, else of the photo that is listed."""
    number = partial(_number, values, where)
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
    """Of the camera, as COLMAP names it: OPENCV stands for all that are its special cases."""
    model = str(values.get("camera_model", "OPENCV")).upper()
    if values.get("is_fisheye") or model in _FISHEYE:
        return "OPENCV_FISHEYE"
    if model == _RATIONAL or any(values.get(key) for key in ("k5", "k6")):
        return _RATIONAL
    if model not in _PERSPECTIVE:
        move = "run `colmap image_undistorter` and load its folder"
        raise InputError(f"{where}: camera model {model} is not supported: {move}")
    return "OPENCV"


def _focal(angle: float | None, side: float) -> float | None:
    return None if not angle else side / 2 / tan(angle / 2)


def _points(path: Path, record: dict[str, Any]) -> SparsePoints | None:
    """From the file that is named or lies beside, which is in the frame of the poses; or from the
    reconstruction in colmap/, to which the poses say what was applied."""
    named = record.get("ply_file_path")
    if isinstance(named, str) and named:
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
