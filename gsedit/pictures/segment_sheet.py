"""The segments of a scene as a picture: views with each object in a color, numbered and named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from colorsys import hsv_to_rgb

import numpy as np
import torch
from jaxtyping import Float, Int
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_erosion, distance_transform_edt, median_filter
from torch import Tensor

from gsedit.formats.pictures import as_picture, eight_bits
from gsedit.pictures.contact_sheet import captioned
from gsedit.select.region import Region, tinted
from gsedit.select.segment import Segments
from gsedit.views.dataset import evenly_spaced
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.render import render
from rasterizer.scene import Gaussians

VIEWS, COLUMNS = 6, 3
"""Most views of a sheet, and how many are beside each other."""
CELL = 400
"""Longer side of a view, pixels."""
TINT, QUIET = 0.15, 0.25
"""How much of its color an object takes (little, as names tell its own), and all else."""


@torch.no_grad()
def segment_sheet(
    scene: Gaussians, segments: Segments, told: Sequence[str], viewpoints: Sequence[Viewpoint]
) -> Image.Image:
    """A sheet of at most VIEWS views; `told` are the names of the segments by number."""
    return _sheet(viewpoints, lambda camera: _view(scene, segments, told, camera))


@torch.no_grad()
def region_sheet(scene: Gaussians, region: Region, viewpoints: Sequence[Viewpoint]) -> Image.Image:
    """A sheet of at most VIEWS views with a region tinted."""
    shown = tinted(scene, region.inside)
    return _sheet(viewpoints, lambda camera: as_picture(render(shown, camera).color))


def _sheet(
    viewpoints: Sequence[Viewpoint], draw_view: Callable[[Camera], Image.Image]
) -> Image.Image:
    """Pictures of at most VIEWS views in rows, each over its name."""
    chosen = [viewpoints[i] for i in evenly_spaced(len(viewpoints), VIEWS)]
    return captioned(
        [(each.name, draw_view(each.camera.scaled(CELL / each.camera.longest))) for each in chosen],
        COLUMNS,
    )


def _view(scene: Gaussians, segments: Segments, told: Sequence[str], camera: Camera) -> Image.Image:
    picture = eight_bits(render(scene, camera).color) / 255
    owner = median_filter(_owners(scene, segments, camera).numpy(), 5)
    colors = np.array([_color(segments, i) for i in range(len(told))])
    for number, row in enumerate(segments.rows):
        here = owner == number
        thing = row.kind == "object"
        share = TINT if thing else QUIET
        picture[here] = (1 - share) * picture[here] + share * colors[number]
        if thing:
            picture[here & ~np.asarray(binary_erosion(here, iterations=2), bool)] = colors[number]
    image = Image.fromarray((picture.clip(0, 1) * 255).round().astype(np.uint8))
    _label(image, owner, told, colors)
    return image


def _owners(scene: Gaussians, segments: Segments, camera: Camera) -> Int[Tensor, "h w"]:
    """The segment that gives most of each pixel; -1 where hardly anything is."""
    weights = color_weights(scene, camera)
    shares: list[Float[Tensor, "h w c"]] = []
    for first in range(0, len(segments.rows), 3):
        flags = [segments.labels == first + i for i in range(3)]
        shares.append(weights.picture(torch.stack(flags, 1).to(scene.means).contiguous()))
    share = torch.cat(shares, -1)
    return torch.where(share.sum(-1) > 0.5, share.argmax(-1), -1)


def _color(segments: Segments, number: int) -> tuple[float, float, float]:
    """A hue of its own for an object; a grey for the ground, walls and background."""
    if segments.rows[number].kind != "object":
        return (0.5, 0.5, 0.55)
    return hsv_to_rgb((0.02 + number * 0.381966) % 1, 0.75, 1.0)  # the golden angle


def _label(
    image: Image.Image, owner: Int[np.ndarray, "h w"], told: Sequence[str], colors: np.ndarray
) -> None:
    """Write the number and name of each segment where it is widest."""
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    boxes: list[tuple[float, float, float, float]] = []
    for number, name in enumerate(told):
        here = owner == number
        if here.mean() < 0.002:
            continue
        inner = np.asarray(distance_transform_edt(np.pad(here, 1)))[1:-1, 1:-1]
        y, x = np.unravel_index(int(inner.argmax()), inner.shape)
        box = _free_box(draw, font, f"{number} {name}", float(x), float(y), image.size, boxes)
        boxes.append(box)
        fill = tuple(int(255 * (0.25 * c)) for c in colors[number])
        draw.rounded_rectangle(box, 4, fill=fill)
        draw.text((box[0] + 4, box[1] + 1), f"{number} {name}", fill="white", font=font)


def _free_box(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    text: str,
    x: float,
    y: float,
    size: tuple[int, int],
    taken: Sequence[tuple[float, float, float, float]],
) -> tuple[float, float, float, float]:
    """The box of a text about a place, within the picture, moved down or up from others."""
    left, top, right, bottom = draw.textbbox((0, 0), text, font=font)
    width, height = right - left + 8, bottom - top + 8
    x0 = min(max(x - width / 2, 1), size[0] - width - 1)
    for step in (0, 1, -1, 2, -2, 3, -3):
        y0 = min(max(y - height / 2 + step * (height + 1), 1), size[1] - height - 1)
        box = (x0, y0, x0 + width, y0 + height)
        if not any(_meet(box, other) for other in taken):
            break
    return box


def _meet(
    first: tuple[float, float, float, float], second: tuple[float, float, float, float]
) -> bool:
    return (
        first[0] < second[2]
        and second[0] < first[2]
        and first[1] < second[3]
        and second[1] < first[3]
    )
