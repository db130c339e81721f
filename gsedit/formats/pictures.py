"""Pictures in and out: sRGB in [0, 1] as tensors, 8 bits a channel in files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import ExifTags, Image, ImageOps
from torch import Tensor

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file, open_regular

Image.MAX_IMAGE_PIXELS = None
"""Pillow's own limit off: `check_picture` stands for it, and can be set."""

LIMIT_VARIABLE = "GSEDIT_MAX_MEGAPIXELS"
"""Environment variable: the most pixels of a picture that is read, millions."""
MAX_MEGAPIXELS = 64.0
"""Without it. A photo of 64 million pixels takes 0.8 GB as float32, and a file of 10 kB can unpack
to one; cameras of phones and most others have up to 50."""


def max_pixels() -> int:
    """The most pixels of a picture that is read. Raises UsageError for a variable that is wrong."""
    given = os.environ.get(LIMIT_VARIABLE) or MAX_MEGAPIXELS
    try:
        return int(float(given) * 1e6)
    except (ValueError, OverflowError):
        raise UsageError(f"{LIMIT_VARIABLE} is {given!r}: give a number of megapixels") from None


def check_picture(picture: Image.Image) -> None:
    """Raise ValueError for a picture, not decoded yet, of more than `max_pixels()` or of
    floating-point pixels, whose white nobody tells."""
    width, height = picture.size
    if width * height > max_pixels():
        raise ValueError(
            f"{width}x{height} pixels, {max_pixels() / 1e6:g} million are allowed: make it "
            f"smaller, or set {LIMIT_VARIABLE}"
        )
    if picture.mode == "F":
        raise ValueError("floating-point pixels: export it with 8 or 16 bits")


@contextmanager
def decoded(path: Path) -> Iterator[Image.Image]:
    """A picture to be decoded, once `check_picture` passed it. Raises what Pillow's decoders do."""
    with open_regular(path) as file, Image.open(file) as picture:
        check_picture(picture)
        yield picture


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """`decoded`, but whatever is raised meanwhile becomes InputError."""
    try:
        with decoded(path) as picture:
            yield picture
    except (GseditError, MemoryError):
        raise
    except Exception as error:  # Pillow's decoders raise a dozen kinds, SyntaxError among them
        reason = str(error).split("\n")[0].partition(" <_io.")[0] or type(error).__name__
        raise InputError(
            f"{path} is no readable picture ({reason}): copy or export it again"
        ) from None


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height), from the header of the file alone."""
    with open_picture(path) as picture:
        return picture.size


def read_picture(path: Path) -> Float[Tensor, "h w 3"]:
    """A picture as float32 in [0, 1]; its pixels as stored: EXIF rotation is not applied.

    Transparent pictures are laid over white.
    """
    rgba = read_photo(path)
    return rgba if rgba.shape[2] == 3 else rgba[..., :3] + (1 - rgba[..., 3:])


def read_photo(
    path: Path, *, turn: bool = False, size: tuple[int, int] | None = None
) -> Float[Tensor, "h w c"]:
    """A picture as float32 in [0, 1]: three channels, or, where it is transparent anywhere, four,
    the colors multiplied by the fourth (laid over black).

    Its pixels are as stored, or turned as its EXIF data say; where `size` (width, height) is given,
    averages over so many equal parts, if it has 8 bits a channel.
    """
    with open_picture(path) as picture:
        if turn:
            picture = ImageOps.exif_transpose(picture)
        if picture.mode.startswith("I"):  # 16 bits of grey, which Pillow's conversion cuts at 255
            grey = torch.from_numpy(np.array(picture).astype(np.float32) / 65535).clamp(0, 1)
            return grey[..., None].repeat(1, 1, 3)
        if not picture.has_transparency_data:
            return _unit(picture.convert("RGB"), size)
        rgba = _unit(picture.convert("RGBA"), size)
    alpha = rgba[..., 3:]
    if (alpha == 1).all():
        return rgba[..., :3].contiguous()
    return torch.cat((rgba[..., :3] * alpha, alpha), -1)


def turned_size(path: Path) -> tuple[int, int]:
    """(width, height) after the turn that the EXIF data say, if any."""
    with open_picture(path) as picture:
        width, height = picture.size
        orientation = picture.getexif().get(ExifTags.Base.Orientation, 1)
    return (height, width) if orientation in (5, 6, 7, 8) else (width, height)


def read_mask(path: Path, width: int, height: int) -> Float[Tensor, "{height} {width}"]:
    """A grey picture of any size at that size, its brightest value 1, nothing between the values
    that it has: files hold 0 and 255, or 0 and 1."""
    with open_picture(path) as picture:
        levels = picture.convert("I" if picture.mode.startswith("I") else "L")
        values = np.array(levels.resize((width, height), Image.Resampling.NEAREST))
    return torch.from_numpy(values / max(1, values.max())).float()


def fitted_size(width: int, height: int, size: int | None) -> tuple[int, int]:
    """(width, height) with the longest side at most `size` pixels, aspect kept, never larger."""
    longest = max(width, height)
    if size is None or size >= longest:
        return width, height
    return max(1, round(width * size / longest)), max(1, round(height * size / longest))


def as_picture(image: Float[Tensor, "h w 3"]) -> Image.Image:
    """An 8-bit picture of sRGB values in [0, 1]; values outside are clipped."""
    return Image.fromarray(eight_bits(image))


def eight_bits(values: Float[Tensor, "*s"]) -> UInt8[np.ndarray, "*s"]:
    """Values in [0, 1] as levels from 0 to 255; values outside are clipped."""
    return (values.detach().clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()


def save_picture(picture: Image.Image, path: Path | str, *, overwrite: bool = False) -> None:
    """Write a PNG, whole or not at all. Raises UsageError as `atomic_path` does."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        # a third of the time of Pillow's 6, and as many bytes
        picture.save(temporary, format="PNG", compress_level=2)


def _unit(picture: Image.Image, size: tuple[int, int] | None) -> Float[Tensor, "h w c"]:
    """From 8 bits a channel to [0, 1], of another size first if one is given."""
    if size is not None:
        picture = picture.resize(size, Image.Resampling.BOX)
    return torch.from_numpy(np.array(picture)).float() / 255


def color_at(text: str) -> Float[np.ndarray, "3"]:
    """Color, 0 to 1, of a pixel named as `PICTURE@COLUMN,ROW`.

    Raises UsageError for another text or a pixel outside, InputError for no picture.
    """
    name, _, place = text.rpartition("@")
    path = existing_file(Path(name).expanduser())
    try:
        column, row = (int(number) for number in place.split(","))
    except ValueError:
        raise UsageError(f"color {text}: name a pixel by column and row: {name}@8,9") from None
    with open_picture(path) as picture:
        shown = np.asarray(picture.convert("RGB"))
    height, width = shown.shape[:2]
    if not (0 <= column < width and 0 <= row < height):
        raise UsageError(f"color {text}: the picture has {width}x{height} pixels, from 0,0")
    return shown[row, column] / 255
