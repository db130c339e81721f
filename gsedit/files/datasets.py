"""Datasets of posed photos, read as views: undistorted, scaled down, sorted by name."""

from __future__ import annotations

from pathlib import Path

from gsedit.errors import InputError, UsageError
from gsedit.files.colmap import model_folder, read_colmap
from gsedit.files.nerfstudio import read_nerfstudio
from gsedit.files.photos import PosedPhoto, SparsePoints, check_size
from gsedit.files.pictures import fitted_size, read_photo
from gsedit.files.undistort import Lens, Undistortion, undistort, undistortion
from gsedit.views.dataset import Dataset, View, evenly_spaced


def load_dataset(path: str | Path, *, size: int | None = None, limit: int | None = None) -> Dataset:
    """Read a nerfstudio folder (or its transforms.json) or a COLMAP folder.

    `size`: the longest side of the pictures, pixels; they are never made larger. `limit`: at most
    this many views, spread evenly over the sorted names. Distortion is undone at full resolution
    first. World coordinates are those of the files. Raises InputError for what cannot be read, and
    UsageError for a `size` or `limit` below 1.
    """
    path = Path(path)
    for name, value in (("size", size), ("limit", limit)):
        if value is not None and value < 1:
            raise UsageError(f"{name} is {value}, but must be at least 1: leave it out for all")
    photos, points = _read(path)
    if not photos:
        raise InputError(f"{path} has no views: it names no photo with a pose, check the dataset")
    for photo in photos:
        check_size(photo, str(path))
    chosen = photos if limit is None else [photos[i] for i in evenly_spaced(len(photos), limit)]
    views: dict[PosedPhoto, View] = {}
    for lens in dict.fromkeys(photo.lens for photo in chosen):  # its map is large: one at a time
        undo = _undistortion(path, lens)
        views |= {photo: _view(photo, undo, size) for photo in chosen if photo.lens == lens}
    xyz, rgb = points or (None, None)
    return Dataset(
        tuple(views[photo] for photo in chosen), points=xyz, point_colors=rgb, source=path
    )


def _read(path: Path) -> tuple[tuple[PosedPhoto, ...], SparsePoints | None]:
    if not path.exists():
        raise InputError(f"{path} does not exist: check the path of the dataset")
    if path.is_file():
        return read_nerfstudio(path)
    if (path / "transforms.json").is_file():
        return read_nerfstudio(path / "transforms.json")
    model = model_folder(path)
    if model is not None:
        return read_colmap(model)
    others = ", ".join(sorted(file.name for file in path.glob("transforms*.json")))
    move = f"name one of {others} itself" if others else "check the path of the dataset"
    raise InputError(f"{path} has neither transforms.json nor a COLMAP model (sparse/0): {move}")


def _undistortion(path: Path, lens: Lens) -> Undistortion:
    """`undistortion`, with the dataset's path in the message of an InputError."""
    try:
        return undistortion(lens)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _view(photo: PosedPhoto, undo: Undistortion, size: int | None) -> View:
    image = undistort(read_photo(photo.path), undo)
    camera = undo.lens.camera(photo.world_to_camera)
    width, height = fitted_size(camera.width, camera.height, size)
    alpha = image[..., 3] if image.shape[2] == 4 else None
    return View(photo.name, camera, image[..., :3], alpha=alpha).resized(width, height)
