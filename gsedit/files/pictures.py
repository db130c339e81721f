"""Pictures in and out: sRGB in [0, 1] as tensors, 8 bits a channel in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import ExifTags, Image, ImageOps
from torch import Tensor

from gsedit.errors import InputError
from gsedit.files.atomic import atomic_path


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height), from the header of the file alone."""
    try:
        with Image.open(path) as picture:
            return picture.size
    except Exception as error:  # see read_photo
        raise _unreadable(path, error) from None


def read_picture(path: Path) -> Float[Tensor, "h w 3"]:
    """A picture as float32 in [0, 1]; its pixels as stored: EXIF rotation is not applied.

    Transparent pictures are laid over white.
    """
    rgba = read_photo(path)
    return rgba if rgba.shape[2] == 3 else rgba[..., :3] + (1 - rgba[..., 3:])


def read_photo(path: Path, *, turn: bool = False) -> Float[Tensor, "h w c"]:
    """A picture as float32 in [0, 1]: three channels, or, where it is transparent anywhere, four,
    the colours multiplied by the fourth (laid over black).

    Its pixels are as stored, or turned as its EXIF data say.
    """
    try:
        with Image.open(path) as picture:
            if turn:
                picture = ImageOps.exif_transpose(picture)
            if picture.mode.startswith(
                "I"
            ):  # 16 bits of grey, which Pillow's conversion cuts at 255
                grey = torch.from_numpy(np.array(picture).astype(np.float32) / 65535).clamp(0, 1)
                return grey[..., None].repeat(1, 1, 3)
            if not picture.has_transparency_data:
                return _unit(np.array(picture.convert("RGB")))
            rgba = _unit(np.array(picture.convert("RGBA")))
    except Exception as error:  # Pillow's decoders raise a dozen kinds, SyntaxError among them
        raise _unreadable(path, error) from None
    alpha = rgba[..., 3:]
    if (alpha == 1).all():
        return rgba[..., :3].contiguous()
    return torch.cat((rgba[..., :3] * alpha, alpha), -1)


def turned_size(path: Path) -> tuple[int, int]:
    """(width, height) after the turn that the EXIF data say, if any."""
    try:
        with Image.open(path) as picture:
            width, height = picture.size
            orientation = picture.getexif().get(ExifTags.Base.Orientation, 1)
    except Exception as error:  # see read_photo
        raise _unreadable(path, error) from None
    return (height, width) if orientation in (5, 6, 7, 8) else (width, height)


def read_mask(path: Path, width: int, height: int) -> Float[Tensor, "{height} {width}"]:
    """A grey picture of any size at that size, its brightest value 1, nothing between the values
    that it has: files hold 0 and 255, or 0 and 1."""
    try:
        with Image.open(path) as picture:
            levels = picture.convert("I" if picture.mode.startswith("I") else "L")
            values = np.array(levels.resize((width, height), Image.Resampling.NEAREST))
    except Exception as error:  # see read_photo
        raise _unreadable(path, error) from None
    return torch.from_numpy(values / max(1, values.max())).float()


def fitted_size(width: int, height: int, size: int | None) -> tuple[int, int]:
    """(width, height) with the longest side at most `size` pixels, aspect kept, never larger."""
    longest = max(width, height)
    if size is None or size >= longest:
        return width, height
    return max(1, round(width * size / longest)), max(1, round(height * size / longest))


def as_picture(image: Float[Tensor, "h w 3"]) -> Image.Image:
    """An 8-bit picture of sRGB values in [0, 1]; values outside are clipped."""
    levels = (image.detach().clamp(0, 1) * 255).round().to(torch.uint8)
    return Image.fromarray(levels.cpu().numpy())


def save_picture(picture: Image.Image, path: Path | str, *, overwrite: bool = False) -> None:
    """Write a PNG, whole or not at all. Raises UsageError as `atomic_path` does."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        picture.save(temporary, format="PNG")


def _unit(pixels: np.ndarray) -> Float[Tensor, "h w c"]:
    """From 8 bits a channel to [0, 1]."""
    return torch.from_numpy(pixels).float() / 255


def _unreadable(path: Path, error: Exception) -> InputError:
    """The error to raise for a file that Pillow cannot decode."""
    reason = str(error).split("\n")[0].removesuffix(f" {str(path)!r}")
    return InputError(f"{path} is no readable picture ({reason}): copy or export it again")
