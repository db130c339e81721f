"""Renders of a scene as files: maps of a view as PNG, EXR or NPY, each written whole."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsedit.formats.pictures import as_picture, eight_bits, save_picture
from gsedit.pictures import Format, MapName
from gsedit.pictures.animations import normal_colors, panels
from gsedit.pictures.maps import Maps, depth_picture, render_maps
from gsedit.run.atomic import atomic_path
from gsedit.run.environment import load_extra
from gsedit.scene.color_space import linear_of_srgb
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.scene import Gaussians

Shown = Sequence[MapName]
COLOR: Shown = ("color",)

EXR_COMMENTS = (
    "R G B: linear light of the sRGB colors, over the background: premultiplied by A where that "
    "is black, as it is unless one was chosen. Z: median depth along the view, scene units, 0 "
    "where nothing is. N.X N.Y N.Z: unit normals in the camera's "
    "axes x right, y up, z towards the viewer."
)


def write_exr(maps: Maps, show: Shown, path: Path, *, overwrite: bool = False) -> None:
    """Write the shown maps as channels, float32, whole or not at all. Raises what `atomic_path`
    raises, GseditError without the package OpenEXR."""
    openexr = load_extra("OpenEXR", "an EXR file", "write .npy")
    header = {
        "compression": openexr.ZIP_COMPRESSION,
        "type": openexr.scanlineimage,
        "comments": EXR_COMMENTS,
    }
    channels = {name: np.ascontiguousarray(v) for name, v in exr_channels(maps, show).items()}
    with atomic_path(path, overwrite=overwrite) as temporary:
        try:
            openexr.File(header, channels).write(str(temporary))
        except RuntimeError as error:  # a full disk too
            raise OSError(str(error)) from error


def write_view(
    scene: Gaussians,
    camera: Camera,
    stem: Path | str,
    *,
    show: Shown = COLOR,
    format: Format = "png",
    background: Float[Tensor, "3"] | None = None,
    transparent: bool = False,
    numerics: Numerics = DEFAULT,
    overwrite: bool = False,
) -> list[Path]:
    """Render a view and write its maps into files that begin with STEM; the files written.

    - png: STEM.png; STEM.depth.npy (`h w` float32: median depth along the view, scene units, 0
      where nothing is) and STEM.depth.png (the same in color); STEM.normals.png, STEM.alpha.png.
      `transparent` writes STEM.png with an alpha channel.
    - npy: the renderer's float32 numbers: STEM.npy (`h w 3`, sRGB), STEM.depth.npy,
      STEM.normals.npy (`h w 3`, see `Maps`), STEM.alpha.npy.
    - exr: STEM.exr with all maps as channels: R G B (linear light), A, Z, N.X N.Y N.Z.

    Raises UsageError where a file exists, unless `overwrite`.
    """
    stem = Path(stem)
    maps = render_maps(scene, camera, show, background=background, numerics=numerics)
    if format == "exr":
        path = stem.with_name(f"{stem.name}.exr")
        write_exr(maps, show, path, overwrite=overwrite)
        return [path]
    written = []
    for name in show:
        own = "" if name == "color" else f".{name}"
        path = stem.with_name(f"{stem.name}{own}.{format}")
        if format == "npy" or name == "depth":
            numbers = path.with_suffix(".npy")
            save_numbers(map_numbers(maps, name), numbers, overwrite=overwrite)
            written.append(numbers)
        if format == "png":
            save_picture(map_picture(maps, name, transparent), path, overwrite=overwrite)
            written.append(path)
    return written


def write_still(
    maps: Maps, show: Shown, path: Path, *, transparent: bool = False, overwrite: bool = False
) -> None:
    """Write maps into one file: an .exr, an .npy of the first map, or else a picture of all, side
    by side. Raises UsageError as `atomic_path` does."""
    suffix = path.suffix.lower()
    if suffix == ".exr":
        write_exr(maps, show, path, overwrite=overwrite)
    elif suffix == ".npy":
        save_numbers(map_numbers(maps, show[0]), path, overwrite=overwrite)
    else:
        alone = map_picture(maps, show[0], transparent) if len(show) == 1 else None
        picture = alone or Image.fromarray(panels(maps, show))
        save_picture(picture, path, overwrite=overwrite)


def map_numbers(maps: Maps, name: MapName) -> Float[np.ndarray, "h w *c"]:
    """A map as float32 numbers."""
    values: Tensor | None = getattr(maps, name)
    assert values is not None, f"{name} was not rendered"
    return values.float().cpu().numpy()


def map_picture(maps: Maps, name: MapName, transparent: bool = False) -> Image.Image:
    """A map as an 8-bit picture; depth with a legend below it."""
    match name:
        case "depth":
            assert maps.depth is not None
            return depth_picture(maps.depth, maps.alpha)
        case "normals":
            return Image.fromarray(normal_colors(maps))
        case "alpha":
            return Image.fromarray(eight_bits(maps.alpha))
    return rgba_picture(maps) if transparent else as_picture(maps.color)


def rgba_picture(maps: Maps) -> Image.Image:
    """Colors with alpha, not premultiplied, as PNG has them. The background must be black."""
    alpha = maps.alpha[..., None]
    color = maps.color / alpha.clamp_min(1e-6)
    return Image.fromarray(eight_bits(torch.cat((color, alpha), -1)), "RGBA")


def exr_channels(maps: Maps, show: Shown) -> dict[str, Float[np.ndarray, "h w"]]:
    """The shown maps as channels of an EXR file."""
    channels = {}
    for name in show:
        values = map_numbers(maps, name)
        match name:
            case "color":
                channels |= dict(zip("RGB", np.moveaxis(linear_of_srgb(values), -1, 0)))
            case "normals":
                channels |= dict(zip(("N.X", "N.Y", "N.Z"), np.moveaxis(values, -1, 0)))
            case "depth":
                channels["Z"] = values
            case "alpha":
                channels["A"] = values
    return channels


def save_numbers(
    values: Float[np.ndarray, "h w *c"], path: Path, *, overwrite: bool = False
) -> None:
    """Write an .npy, whole or not at all."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        np.save(temporary, values)
