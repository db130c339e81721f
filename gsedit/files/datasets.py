"""Datasets of posed photos, read as views: undistorted, scaled down, sorted by name.

A photo's pixels are read when the view is asked for them (see gsedit.views.kept); what can be
wrong with a dataset without reading them is found here.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.files.colmap import model_folder, read_colmap
from gsedit.files.nerfstudio import read_nerfstudio
from gsedit.files.photo_pixels import Source, matched, read_pixels
from gsedit.files.photos import Capture, PosedPhoto, reduced_copy
from gsedit.files.pictures import fitted_size
from gsedit.files.recentre import offset_of
from gsedit.files.undistort import Lens, ideal_lens, undistortion
from gsedit.views.dataset import Dataset, View, evenly_spaced
from gsedit.views.kept import Kept

ENOUGH = 8
"""Photos that must remain where others are missing: with fewer, one in eight cannot be held out."""
NAMED = 3
"""Missing photos that a message names."""


def load_dataset(path: str | Path, *, size: int | None = None, limit: int | None = None) -> Dataset:
    """Read a nerfstudio folder (or its transforms.json) or a COLMAP folder.

    `size`: the longest side of the pictures, pixels; they are never made larger. `limit`: at most
    this many views, spread evenly over the sorted names. Distortion is undone before a photo is
    made smaller. World coordinates are those of the files, less `Dataset.offset`. Photos that are
    listed and not there are left out, with a note in `Dataset.notes`; they are an error where fewer
    than half or fewer than 8 remain. A photo that cannot be decoded is an InputError when it is
    read.

    Raises InputError for what cannot be read, and UsageError for a `size` or `limit` below 1.
    """
    path = Path(path)
    for name, value in (("size", size), ("limit", limit)):
        if value is not None and value < 1:
            raise UsageError(f"{name} is {value}, but must be at least 1: leave it out for all")
    capture = _read(path)
    notes = [*capture.notes, *_missing(path, capture)]
    offset = offset_of([photo.world_to_camera for photo in capture.photos])
    photos = capture.photos
    chosen = photos if limit is None else [photos[i] for i in evenly_spaced(len(photos), limit)]
    sources = [_source(photo, size, str(path)) for photo in chosen]
    notes += _notes(chosen, sources)
    if offset.any():
        place = ", ".join(f"{value:g}" for value in offset.tolist())
        notes.append(f"coordinates are far from the origin: the frame's origin is ({place}) now")
    views = _views(path, chosen, sources, size, offset)
    xyz, rgb = capture.points or (None, None)
    return Dataset(
        views,
        points=None if xyz is None else (xyz.double() - offset).float(),
        point_colors=rgb,
        source=path,
        offset=tuple(offset.tolist()),
        notes=tuple(notes),
    )


def _read(path: Path) -> Capture:
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


def _missing(path: Path, capture: Capture) -> list[str]:
    """A note about photos that are not there. Raises InputError where too few are."""
    there, missing = len(capture.photos), capture.missing
    if not missing:
        if not there:
            raise InputError(
                f"{path} has no views: it names no photo with a pose, check the dataset"
            )
        return []
    names = ", ".join(missing[:NAMED]) + (", ..." if len(missing) > NAMED else "")
    listed = f"{path} lists {there + len(missing)} photos and {len(missing)} of them "
    listed += f"{'is' if len(missing) == 1 else 'are'} not there ({names})"
    if there < max(ENOUGH, len(missing)):
        raise InputError(f"{listed}: copy them there, or remove their entries")
    return [f"{listed}: going on with the other {there}"]


class _Scaled(NamedTuple):
    """What a note says of photos whose size is not that of their calibration."""

    folder: str
    size: tuple[int, int]
    calibrated: tuple[int, int]


def _source(photo: PosedPhoto, size: int | None, where: str) -> Source:
    """The file to read a photo from, a smaller copy where that is enough, and its lens there."""
    path, images = photo.path, _images_folder(photo)
    if size is not None and images is not None:
        longest = min(size, max(photo.lens.width, photo.lens.height))
        path = reduced_copy(path, images, longest)
    return matched(path, photo.lens, photo.mask, where)


def _images_folder(photo: PosedPhoto) -> Path | None:
    """The folder `images` of the dataset that a photo is in, if it is in one."""
    inside = photo.path.parents[: len(Path(photo.name).parts)]  # the last holds all photos
    return next((folder for folder in inside if folder.name == "images"), None)


def _notes(photos: list[PosedPhoto] | tuple[PosedPhoto, ...], sources: list[Source]) -> list[str]:
    """Sizes that differ from the calibration, and masks, in a line each."""
    notes = []
    scaled = Counter(
        _Scaled(source.path.parent.name, source.size, (photo.lens.width, photo.lens.height))
        for photo, source in zip(photos, sources)
    )
    for (folder, (width, height), (w, h)), count in scaled.items():
        if (width, height) != (w, h):
            notes.append(
                f"{count} photos in {folder} are {width}x{height} and were calibrated at {w}x{h}: "
                f"intrinsics are scaled by {width / w:.4g}"
            )
    masks = [source.mask for source in sources if source.mask is not None]
    if masks:
        notes.append(
            f"{len(masks)} of {len(sources)} photos have a mask ({masks[0].parent.name}/): where "
            "it is black, the photo is not used"
        )
    return notes


def _views(
    path: Path,
    photos: list[PosedPhoto] | tuple[PosedPhoto, ...],
    sources: list[Source],
    size: int | None,
    offset: Float[Tensor, "3"],
) -> tuple[View, ...]:
    kept, undo = Kept(), lru_cache(maxsize=2)(undistortion)  # a map of 1920x1080 is 33 MB
    ideal = {lens: _ideal(path, lens) for lens in dict.fromkeys(s.lens for s in sources)}
    views = []
    for photo, source in zip(photos, sources):
        camera = ideal[source.lens].camera(_moved(photo.world_to_camera, offset))
        width, height = fitted_size(camera.width, camera.height, size)
        camera = camera.resized(width, height)
        views.append(kept.view(photo.name, camera, read_pixels(source, undo, width, height)))
    return tuple(views)


def _ideal(path: Path, lens: Lens) -> Lens:
    """`ideal_lens`, with the dataset's path in the message of an InputError."""
    try:
        return ideal_lens(lens)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _moved(
    world_to_camera: Float[Tensor, "4 4"], offset: Float[Tensor, "3"]
) -> Float[Tensor, "4 4"]:
    """The same camera in a world of which the origin is at `offset`."""
    pose = world_to_camera.clone()
    pose[:3, 3] += pose[:3, :3] @ offset
    return pose
