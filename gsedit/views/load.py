"""Datasets of posed photos, read as views: undistorted, scaled down, sorted by name.

A photo's pixels are read when the view is asked for them (gsedit.views.lazy_views); what can be
wrong with a dataset without reading them is found here. A capture far from the origin, as
georeferenced ones are, is moved there in float64: float32 has a step of 0.5 at 5e6.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from math import ceil, log10
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.formats.pictures import fitted_size, picture_size, read_mask, read_photo, turned_size
from gsedit.views.colmap import model_folder, read_colmap
from gsedit.views.dataset import LEAST_SHARE, Dataset, View
from gsedit.views.image_ops import downscale
from gsedit.views.lazy_views import PixelCache, Pixels
from gsedit.views.nerfstudio import read_nerfstudio
from gsedit.views.photos import Capture, PosedPhoto, reduced_copy
from gsedit.views.undistort import Lens, Undistortion, ideal_lens, undistort, undistortion
from gsedit.views.viewpoints import dataset_near

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


NAMED = 3
"""Missing photos that a message names."""


def load_dataset(path: str | Path, *, size: int | None = None) -> Dataset:
    """Read a nerfstudio folder (or its transforms.json) or a COLMAP folder.

    `size`: the longest side of the pictures, pixels; they are never made larger. Distortion is
    undone before a photo is made smaller. World coordinates are those of the files, less
    `Dataset.offset`. Photos that are listed and not there are left out, with a note in
    `Dataset.notes`; they are an error where fewer than half or fewer than 8 remain. A photo that
    cannot be decoded is an InputError when it is read. Cameras keep the renderer's near plane, 0.01
    units, unless the sparse points are so close together that they need a nearer one.

    Raises InputError for what cannot be read, and UsageError for a `size` below 1.
    """
    path = Path(path)
    if size is not None and size < 1:
        raise UsageError(f"size is {size}, but must be at least 1: leave it out for all")
    capture = _read(path)
    notes = _missing(path, capture)
    offset = offset_of([photo.world_to_camera for photo in capture.photos])
    sources = [_source(photo, size, str(path)) for photo in capture.photos]
    notes += [*_notes(capture.photos, sources), *_new_origin(offset)]
    views = _views(path, capture.photos, sources, size, offset)
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
    if there < max(8, len(missing)):  # with fewer, one in eight cannot be held out
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


def _notes(photos: tuple[PosedPhoto, ...], sources: list[Source]) -> list[str]:
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
    photos: tuple[PosedPhoto, ...],
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
        pixels = partial(read_pixels, source, undo, width, height)
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


LARGE_PIXELS = 16_000_000
"""Pixels above which a photo that is read small is averaged in 8 bits first: 200 MB of float32."""


class Source(NamedTuple):
    """Files and lens that a photo's pixels come from."""

    path: Path
    size: tuple[int, int]
    """Width and height of its pixels, turned if they are to be."""
    lens: Lens
    """Lens for the size of the photo."""
    mask: Path | None
    turn: bool
    """Whether it is to be turned as its EXIF data say."""


def matched(path: Path, lens: Lens, mask: Path | None, where: str) -> Source:
    """The photo of a file with its lens: scaled where the photo has more or fewer pixels than the
    calibration, and turned as its EXIF data say where only then the proportions are the same.

    Raises InputError for a photo or a mask of other proportions.
    """
    size, calibrated = picture_size(path), (lens.width, lens.height)
    turn = not _fits(size, calibrated)
    shown = turned_size(path) if turn else size
    if not _fits(shown, calibrated):
        raise InputError(
            f"{where}: {path} is {size[0]}x{size[1]} pixels, its camera "
            f"{lens.width}x{lens.height}: the proportions differ; use the photos that the poses "
            "were made from"
        )
    if mask is not None and not _fits(masked := picture_size(mask), shown):
        raise InputError(
            f"{where}: the mask {mask} is {masked[0]}x{masked[1]} pixels, its photo "
            f"{shown[0]}x{shown[1]}: the proportions differ; turn or cut the mask as the photo is"
        )
    return Source(path, shown, lens.scaled(*shown), mask, turn)


def _fits(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether a picture of that size is one of the other size, made larger or smaller."""
    scale = max(size) / max(other)
    return all(abs(side - its * scale) <= max(1.0, scale) for side, its in zip(size, other))


def read_pixels(
    source: Source, undistortion: Callable[[Lens], Undistortion], width: int, height: int
) -> Pixels:
    """The pixels of a photo for a view of so many. Raises InputError for a file that cannot be
    decoded."""
    undo = undistortion(source.lens)
    size = _read_size(source.size, width, height) if undo.lookup is None else None
    photo = read_photo(source.path, turn=source.turn, size=size)
    channels = photo.shape[2]
    if source.mask is not None:
        hidden = read_mask(source.mask, photo.shape[1], photo.shape[0]) < 0.5
        photo = torch.cat((photo, hidden[..., None].float()), -1)
    photo = downscale(undistort(photo, undo), width, height)
    return Pixels(
        photo[..., :3].clamp(0, 1),
        None if source.mask is None else photo[..., -1] < LEAST_SHARE,
        photo[..., 3].clamp(0, 1) if channels == 4 else None,
    )


def _read_size(size: tuple[int, int], width: int, height: int) -> tuple[int, int] | None:
    """The size at which a photo for a view of `width` x `height` is made float32: smaller than it
    is where it has more than LARGE_PIXELS, but twice the view's or more."""
    times = min(size[0] // (2 * width), size[1] // (2 * height))
    if size[0] * size[1] <= LARGE_PIXELS or times < 2:
        return None
    return round(size[0] / times), round(size[1] / times)
