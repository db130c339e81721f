"""Datasets of posed photos, read as views: undistorted, scaled down, sorted by name.

A photo's pixels are read when the view is asked for them (gsedit.datasets.lazy_views); what can be
wrong with a dataset without reading them is found here. A capture far from the origin, as
georeferenced ones are, is moved there in float64: float32 has a step of 0.5 at 5e6.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from math import ceil, log10
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.colmap import model_folder, read_colmap
from gsedit.datasets.dataset import Dataset, View, evenly_spaced
from gsedit.datasets.lazy_views import PixelCache
from gsedit.datasets.near import dataset_near
from gsedit.datasets.nerfstudio import read_nerfstudio
from gsedit.datasets.photo_pixels import Source, matched, read_pixels
from gsedit.datasets.photos import Capture, PosedPhoto, reduced_copy
from gsedit.datasets.undistort import Lens, ideal_lens, undistortion
from gsedit.errors import InputError, UsageError
from gsedit.formats.pictures import fitted_size

FAR = 100.0
"""Distance of the cameras from the origin, in multiples of how far they spread, above which the
frame is moved. At that distance a step of float32 is 1e-5 of the spread."""


def offset_of(world_to_cameras: Sequence[Float[Tensor, "4 4"]]) -> Float[Tensor, "3"]:
    """Vector (float64) to subtract from world coordinates: 0 unless the cameras are far away.

    Round numbers near the middle of the cameras, so that they stay the same where a few photos are
    added or left out, and are exact in float32 and in decimals.
    """
    none = torch.zeros(3, dtype=torch.float64)
    if len(world_to_cameras) < 2:
        return none
    poses = torch.stack([pose.double() for pose in world_to_cameras])
    centers = -(poses[:, :3, :3].mT @ poses[:, :3, 3:])[..., 0]
    middle = centers.mean(0)
    spread = float((centers - middle).norm(dim=-1).max())
    if spread == 0 or float(middle.norm()) < FAR * spread:
        return none
    unit = 10.0 ** ceil(log10(spread))
    return (middle / unit).round() * unit


ENOUGH_VIEWS = 8
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
    read. Cameras keep the renderer's near plane, 0.01 units, unless the sparse points are so close
    together that they need a nearer one.

    Raises InputError for what cannot be read, and UsageError for a `size` or `limit` below 1.
    """
    path = Path(path)
    for name, value in (("size", size), ("limit", limit)):
        if value is not None and value < 1:
            raise UsageError(f"{name} is {value}, but must be at least 1: leave it out for all")
    capture = _read(path)
    notes = _missing(path, capture)
    offset = offset_of([photo.world_to_camera for photo in capture.photos])
    photos = capture.photos
    chosen = photos if limit is None else [photos[i] for i in evenly_spaced(len(photos), limit)]
    sources = [_source(photo, size, str(path)) for photo in chosen]
    notes += [*_notes(chosen, sources), *_new_origin(offset)]
    views = _views(path, chosen, sources, size, offset)
    xyz, rgb = capture.points or (None, None)
    return dataset_near(
        Dataset(
            views,
            points=None if xyz is None else (xyz.double() - offset).float(),
            point_colors=rgb,
            source=path,
            offset=tuple(offset.tolist()),
            notes=tuple(notes),
        )
    )


def _new_origin(offset: Float[Tensor, "3"]) -> list[str]:
    """Name the new origin, where coordinates were far from the old one."""
    if not offset.any():
        return []
    place = ", ".join(f"{value:g}" for value in offset.tolist())
    return [f"coordinates are far from the origin: the frame's origin is ({place}) now"]


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
    if there < max(ENOUGH_VIEWS, len(missing)):
        raise InputError(f"{listed}: copy them there, or remove their entries")
    return [f"{listed}: going on with the other {there}"]


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
        (source.path.parent.name, source.size, (photo.lens.width, photo.lens.height))
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
    kept, undo = PixelCache(), lru_cache(maxsize=2)(undistortion)  # a map of 1920x1080 is 33 MB
    ideal = {lens: _ideal(path, lens) for lens in dict.fromkeys(s.lens for s in sources)}
    views = []
    for photo, source in zip(photos, sources):
        camera = ideal[source.lens].camera(_moved(photo.world_to_camera, offset))
        width, height = fitted_size(camera.width, camera.height, size)
        camera = camera.resized(width, height)
        pixels = read_pixels(source, undo, width, height)
        views.append(kept.view(photo.name, camera, pixels, source.lens))
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
    """Camera pose in a world whose origin is at `offset`."""
    pose = world_to_camera.clone()
    pose[:3, 3] += pose[:3, :3] @ offset
    return pose
