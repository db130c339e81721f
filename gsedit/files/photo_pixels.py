"""The pixels of a photo as a view has them: read, turned, undistorted, made smaller, masked."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.pictures import picture_size, read_mask, read_photo, turned_size
from gsedit.files.undistort import Lens, Undistortion, undistort
from gsedit.views.image_ops import downscale
from gsedit.views.kept import Pixels

PROPORTIONS = 1.0
"""Pixels by which a side may differ from that of the calibrated photo made smaller: rounding."""
HIDDEN = 1e-3
"""Least share of a pixel that is hidden for the pixel to be hidden: above what rounding leaves."""


class Source(NamedTuple):
    """Where the pixels of a photo come from."""

    path: Path
    size: tuple[int, int]
    """Width and height of its pixels, turned if they are to be."""
    lens: Lens
    """For that size."""
    mask: Path | None
    turn: bool
    """Whether it is to be turned as its EXIF data say."""


def matched(path: Path, lens: Lens, mask: Path | None, where: str) -> Source:
    """The photo of a file with its lens: scaled where the photo has more or fewer pixels than the
    calibration, and turned as its EXIF data say where only then the proportions are the same.

    Raises InputError for a photo of other proportions.
    """
    size = picture_size(path)
    if _fits(size, lens):
        return Source(path, size, lens.scaled(*size), mask, turn=False)
    turned = turned_size(path)
    if _fits(turned, lens):
        return Source(path, turned, lens.scaled(*turned), mask, turn=True)
    raise InputError(
        f"{where}: {path} is {size[0]}x{size[1]} pixels, its camera {lens.width}x{lens.height}: "
        "the proportions differ; use the photos that the poses were made from"
    )


def _fits(size: tuple[int, int], lens: Lens) -> bool:
    """Whether a picture of that size is the calibrated one, larger or smaller."""
    scale = max(size) / max(lens.width, lens.height)
    return all(
        abs(side - calibrated * scale) <= PROPORTIONS * max(1.0, scale)
        for side, calibrated in zip(size, (lens.width, lens.height))
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
    photo = read_photo(source.path, turn=source.turn)
    channels = photo.shape[2]
    if source.mask is not None:
        hidden = read_mask(source.mask, *source.size) < 0.5
        photo = torch.cat((photo, hidden[..., None].float()), -1)
    photo = downscale(undistort(photo, undo), width, height)
    return Pixels(
        photo[..., :3].clamp(0, 1),
        None if source.mask is None else photo[..., -1] < HIDDEN,
        _alpha(photo) if channels == 4 else None,
    )


def _alpha(photo: Float[Tensor, "h w c"]) -> Float[Tensor, "h w"]:
    return photo[..., 3].clamp(0, 1)
