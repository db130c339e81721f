"""The pixels of a photo as a view has them: read, turned, undistorted, made smaller, masked."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import LEAST_SHARE
from gsedit.datasets.image_ops import downscale
from gsedit.datasets.lazy_views import Pixels
from gsedit.datasets.undistort import Lens, Undistortion, undistort
from gsedit.errors import InputError
from gsedit.formats.pictures import picture_size, read_mask, read_photo, turned_size

PROPORTIONS = 1.0
"""Pixels by which a side may differ from that of the calibrated photo made smaller: rounding."""

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
    return all(
        abs(side - its * scale) <= PROPORTIONS * max(1.0, scale) for side, its in zip(size, other)
    )


def read_pixels(
    source: Source, undistortion: Callable[[Lens], Undistortion], width: int, height: int
) -> Callable[[], Pixels]:
    """A function that reads them, for a view of so many pixels. It raises InputError for a file
    that cannot be decoded."""
    return partial(_read, source, undistortion, width, height)


def _read(
    source: Source, undistortion: Callable[[Lens], Undistortion], width: int, height: int
) -> Pixels:
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
        _alpha(photo) if channels == 4 else None,
    )


def _read_size(size: tuple[int, int], width: int, height: int) -> tuple[int, int] | None:
    """The size at which a photo for a view of `width` x `height` is made float32: smaller than it
    is where it has more than LARGE_PIXELS, but twice the view's or more."""
    times = min(size[0] // (2 * width), size[1] // (2 * height))
    if size[0] * size[1] <= LARGE_PIXELS or times < 2:
        return None
    return round(size[0] / times), round(size[1] / times)


def _alpha(photo: Float[Tensor, "h w c"]) -> Float[Tensor, "h w"]:
    return photo[..., 3].clamp(0, 1)
