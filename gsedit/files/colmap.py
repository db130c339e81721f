"""COLMAP folders (cameras, images, points3D; binary or text) through pycolmap."""

from __future__ import annotations

from pathlib import Path
from struct import Struct, error
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.inputs import existing_file, file_inside
from gsedit.files.photos import PosedPhoto, SparsePoints, missing_photo
from gsedit.files.undistort import Lens

_PARAMETERS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
}
"""The models that are pinholes with Brown-Conrady distortion, parameters in COLMAP's order."""
_U32, _U64 = Struct("<I"), Struct("<Q")
_CAMERA = Struct("<Ii2Q")  # id, model, width, height; then the parameters
_IMAGE = Struct("<I7dI")  # id, pose, camera; then the name, a zero byte, and 24 bytes a keypoint
_POINT = Struct("<Q3d3Bd")  # id, xyz, rgb, error; then 8 bytes a track entry
_FRAME = Struct("<2I7d")  # id, rig, pose; then 16 bytes a picture
_SENSOR = Struct("<iI")  # type, id; all but a rig's first: one byte, and a pose of 56 if it is 1


def model_folder(folder: Path) -> Path | None:
    """Where the reconstruction lies in a dataset folder, or None."""
    for candidate in (folder / "sparse" / "0", folder / "sparse", folder):
        if any((candidate / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt")):
            return candidate
    return None


def read_colmap(model: Path) -> tuple[tuple[PosedPhoto, ...], SparsePoints | None]:
    """All registered photos of a reconstruction, sorted by name, and its points.

    Photos are looked for in `images/` beside the model or beside the `sparse` folder around it.
    Raises InputError where the model or a photo is missing, cut off, or of another camera model.
    """
    reconstruction = _open(model)
    images = _images_folder(model)
    posed = [
        _photo(model, images, image) for image in reconstruction.images.values() if image.has_pose
    ]
    points = list(reconstruction.points3D.values())
    if not points:
        return tuple(sorted(posed, key=lambda photo: photo.name)), None
    xyz = torch.tensor([p.xyz.tolist() for p in points], dtype=torch.float32)
    rgb = torch.tensor([p.color.tolist() for p in points], dtype=torch.float32) / 255
    return tuple(sorted(posed, key=lambda photo: photo.name)), SparsePoints(xyz, rgb)


def _open(model: Path) -> Any:
    import pycolmap

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
    except (error, ValueError, IndexError):
        end = len(data) + 1
    if end > len(data):
        raise InputError(f"{path} is cut off ({len(data)} bytes): copy or export it again")


def _camera_end(data: bytes, at: int) -> int:
    _CAMERA.unpack_from(data, at)
    return at + _CAMERA.size  # at least: the number of parameters depends on the model


def _image_end(data: bytes, at: int) -> int:
    return _list_end(data, data.index(b"\0", at + _IMAGE.size) + 1, _U64, 24)


def _point_end(data: bytes, at: int) -> int:
    return _list_end(data, at + _POINT.size, _U64, 8)


def _frame_end(data: bytes, at: int) -> int:
    return _list_end(data, at + _FRAME.size, _U32, 16)


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
    "cameras.bin": _camera_end,
    "images.bin": _image_end,
    "points3D.bin": _point_end,
    "frames.bin": _frame_end,
    "rigs.bin": _rig_end,
}
"""The byte behind the row that starts at a byte; layouts: COLMAP's scene/reconstruction_io."""


def _check_cameras(path: Path, reconstruction: Any) -> None:
    """Raise InputError where cameras.bin is cut off: pycolmap fills up the missing parameters from
    uninitialised memory.
    """
    needed = _U64.size + sum(
        _CAMERA.size + 8 * len(camera.params) for camera in reconstruction.cameras.values()
    )
    if path.is_file() and path.stat().st_size < needed:
        raise InputError(f"{path} is cut off ({needed} bytes needed): copy or export it again")


def _images_folder(model: Path) -> Path:
    for folder in (model / "images", model.parent / "images", model.parent.parent / "images"):
        if folder.is_dir():
            return folder
    raise InputError(f"{model} has no images folder beside it: put the photos into one")


def _photo(model: Path, images: Path, image: Any) -> PosedPhoto:
    where = f"{model}: image {image.name}"
    path = file_inside(images, image.name, where)
    if not path.is_file():
        raise missing_photo(path, where)
    rows = torch.tensor(image.cam_from_world().matrix(), dtype=torch.float64)
    return PosedPhoto(image.name, path, _to_4x4(rows, where), _lens(image.camera, where))


def _to_4x4(rows: Float[Tensor, "3 4"], where: str) -> Float[Tensor, "4 4"]:
    if not rows.isfinite().all():
        raise InputError(f"{where}: its pose is not finite: export the model again")
    return torch.cat((rows, torch.tensor([[0.0, 0.0, 0.0, 1.0]], dtype=torch.float64)))


def _lens(camera: Any, where: str) -> Lens:
    names = _PARAMETERS.get(camera.model_name)
    if names is None:
        raise InputError(
            f"{where}: camera model {camera.model_name} is not supported: run "
            "`colmap image_undistorter` (or pycolmap.undistort_images) and load its folder"
        )
    values = dict(zip(names, camera.params.tolist()))
    focal = values.pop("f", None)
    if focal is not None:
        values["fx"] = values["fy"] = focal
    if min(values["fx"], values["fy"], camera.width, camera.height) <= 0:
        raise InputError(f"{where}: no positive focal length or size: export the model again")
    return Lens(width=camera.width, height=camera.height, **values)
