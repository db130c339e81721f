"""COLMAP folders (cameras, images, points3D; binary or text) through pycolmap."""

from __future__ import annotations

from pathlib import Path
from struct import Struct, error
from typing import Any

import torch

from gsedit.errors import InputError
from gsedit.formats.limits import check_lens, check_points, check_pose
from gsedit.run.inputs import existing_file, open_regular, refuse_doubles, safe_name
from gsedit.views.photos import REDUCED, Capture, PosedPhoto, SparsePoints, find_mask, find_photo
from gsedit.views.undistort import ColmapLens, Lens, import_pycolmap

_U32, _U64 = Struct("<I"), Struct("<Q")
_CAMERA = Struct("<Ii2Q")  # id, model, width, height; then the parameters
_IMAGE = Struct("<I7dI")  # id, pose, camera; then the name, a zero byte, and 24 bytes a keypoint
_POINT = Struct("<Q3d3Bd")  # id, xyz, rgb, error; then 8 bytes a track entry
_FRAME = Struct("<2I7d")  # id, rig, pose; then 16 bytes a picture
_SENSOR = Struct("<iI")  # type, id; all but a rig's first: one byte, and a pose of 56 if it is 1


def model_folder(folder: Path) -> Path | None:
    """Find the reconstruction in a dataset folder; None where there is none."""
    for candidate in (folder / "sparse" / "0", folder / "sparse", folder):
        if any((candidate / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt")):
            return candidate
    return None


def read_colmap(model: Path) -> Capture:
    """All registered photos of a reconstruction, and its points.

    Photos are looked for in `images/` beside the model or beside the `sparse` folder around it,
    their masks in `masks/` beside `images/`. Raises InputError where the model or all photos are
    missing, or the model is cut off or has a camera that is no lens.
    """
    reconstruction = _open(model)
    images = _images_folder(model)
    photos, missing = [], []
    for image in reconstruction.images.values():
        if image.has_pose:
            photo = _photo(model, images, image)
            (missing.append(_name(model, image)) if photo is None else photos.append(photo))
    photos.sort(key=lambda photo: photo.name)
    refuse_doubles((photo.name for photo in photos), f"{model}: two images")
    points = points_of(reconstruction, str(model))
    return Capture(tuple(photos), tuple(sorted(missing)), points)


def read_colmap_points(model: Path) -> SparsePoints | None:
    """The points of a reconstruction alone. Raises InputError for a model that cannot be read."""
    return points_of(_open(model), str(model))


def points_of(reconstruction: Any, where: str) -> SparsePoints | None:
    """The points of a reconstruction; None if it has none. Raises InputError, which begins with
    `where`, for points that are not finite or absurdly far."""
    points = list(reconstruction.points3D.values())
    if not points:
        return None
    xyz = torch.tensor([p.xyz.tolist() for p in points], dtype=torch.float64)
    check_points(xyz, where)
    rgb = torch.tensor([p.color.tolist() for p in points], dtype=torch.float32) / 255
    return SparsePoints(xyz, rgb)


def _open(model: Path) -> Any:
    pycolmap = import_pycolmap()

    for name in _ROWS:
        for place in (model / name, (model / name).with_suffix(".txt")):
            if place.exists():
                open_regular(place).close()  # pycolmap would wait for a pipe
    if (model / "cameras.bin").is_file():
        for name in _ROWS:
            if (model / name).is_file():
                _check_complete(model / name)
    level, pycolmap.logging.minloglevel = pycolmap.logging.minloglevel, 3  # only what is fatal
    try:
        reconstruction = pycolmap.Reconstruction(model)
        _check_cameras(model / "cameras.bin", reconstruction)
    except (ValueError, IndexError, RuntimeError, MemoryError, OverflowError) as problem:
        reason = str(problem).split("\n")[0].split("] ")[-1].strip()
        raise InputError(
            f"{model} is no readable COLMAP model ({reason}): export it again"
        ) from None
    finally:
        pycolmap.logging.minloglevel = level
    return reconstruction


def _check_complete(path: Path) -> None:
    """Walk the rows of a .bin file; raise InputError where it is cut off.

    pycolmap takes what it cannot read from uninitialised memory, counts included: it may then loop
    for minutes, or end the process.
    """
    data = existing_file(path).read_bytes()
    try:
        (count,), end = _U64.unpack_from(data), _U64.size
        for _ in range(count):
            end = _ROWS[path.name](data, end)
    except (error, ValueError, IndexError, OverflowError):
        end = len(data) + 1
    if end > len(data):
        raise InputError(f"{path} is cut off ({len(data)} bytes): copy or export it again")


def _rig_end(data: bytes, at: int) -> int:
    (sensors,) = _U32.unpack_from(data, at + 4)
    at += 8 + _SENSOR.size * (sensors > 0)
    for _ in range(sensors - 1):
        at += _SENSOR.size
        at += 57 if data[at] else 1
    return at


def _list_end(data: bytes, at: int, count: Struct, entry_bytes: int) -> int:
    return at + count.size + entry_bytes * count.unpack_from(data, at)[0]


_ROWS = {
    # at least: the number of a camera's parameters depends on its model
    "cameras.bin": lambda data, at: _CAMERA.unpack_from(data, at) and at + _CAMERA.size,
    "images.bin": lambda data, at: _list_end(
        data, data.index(b"\0", at + _IMAGE.size) + 1, _U64, 24
    ),
    "points3D.bin": lambda data, at: _list_end(data, at + _POINT.size, _U64, 8),
    "frames.bin": lambda data, at: _list_end(data, at + _FRAME.size, _U32, 16),
    "rigs.bin": _rig_end,
}
"""The byte behind the row that starts at a byte; layouts: COLMAP's scene/reconstruction_io."""


def _check_cameras(path: Path, reconstruction: Any) -> None:
    """Raise InputError where cameras.bin is cut off: pycolmap fills up the missing parameters from
    uninitialised memory."""
    needed = _U64.size + sum(
        _CAMERA.size + 8 * len(camera.params) for camera in reconstruction.cameras.values()
    )
    if path.is_file() and path.stat().st_size < needed:
        raise InputError(f"{path} is cut off ({needed} bytes needed): copy or export it again")


def _images_folder(model: Path) -> Path:
    """The folder of the photos, or of their smaller copies where only these are there."""
    names = ("images", *(f"images_{factor}" for factor in reversed(REDUCED)))
    for name in names:
        for around in (model, model.parent, model.parent.parent):
            if (around / name).is_dir():
                return around / name
    raise InputError(f"{model} has no images folder beside it: put the photos into one")


def _photo(model: Path, images: Path, image: Any) -> PosedPhoto | None:
    """None where the file is not there."""
    name = safe_name(_name(model, image), f"{model}: image {image.image_id}")
    where = f"{model}: image {image.image_id} ({name})"
    path = find_photo(images, name, where)
    if path is None:
        return None
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3] = torch.tensor(image.cam_from_world().matrix())
    check_pose(pose, where)
    mask = find_mask(images.parent / "masks", name)
    return PosedPhoto(name, path, pose, _lens(image.camera, where), mask)


def _name(model: Path, image: Any) -> str:
    """The name of an image. Raises InputError where it is no text."""
    try:
        return image.name
    except UnicodeDecodeError:
        raise InputError(
            f"{model}: the name of image {image.image_id} is not UTF-8: rename the photo and "
            "export the model again"
        ) from None


def _lens(camera: Any, where: str) -> Lens:
    if not camera.focal_length_idxs():  # asked for one, pycolmap ends the process
        raise InputError(
            f"{where}: camera model {camera.model_name} is not supported (its pictures show all "
            "around): cut pinhole views out of them first"
        )
    size, params = (camera.width, camera.height), tuple(camera.params.tolist())
    focal = camera.focal_length_x, camera.focal_length_y
    center = camera.principal_point_x, camera.principal_point_y
    check_lens(focal, center, size, where, params)
    bends = len(params) > len((*camera.focal_length_idxs(), *camera.principal_point_idxs()))
    return Lens(
        *focal, *center, *size,
        distorted=ColmapLens(camera.model_name, params, *size) if bends else None,
    )  # fmt: skip
