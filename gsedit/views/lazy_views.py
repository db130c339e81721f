"""Pictures that are made when they are asked for, and kept in 8 bits while there is room.

Three hundred photos of 1920x1080 are 7.5 GB as float32 and 1.9 GB in 8 bits; read again from
their files they are nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from mmap import mmap
from typing import Any, NamedTuple, cast

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from gsedit.views.dataset import Dataset, View
from gsedit.views.undistort import Lens
from rasterizer.camera import Camera

MOST_BYTES = 1 << 30
"""Bytes that one `PixelCache` holds. Pictures beyond are made anew each time: reading a JPEG of
1920x1080 takes 20 ms, and a step of a fit on it seconds."""


class Pixels(NamedTuple):
    """Pixels of a `View`: its fields besides name and camera."""

    image: Float[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"] | None = None
    alpha: Float[Tensor, "h w"] | None = None


class PixelCache:
    """Makes views whose pictures are made when they are read."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self.room = most_bytes
        self._planned = 0
        self._last: tuple[_Picture, _Levels] | None = None

    def view(
        self, name: str, camera: Camera, make: Callable[[], Pixels], lens: Lens | None = None
    ) -> View:
        """A view of which `make` returns the pixels, of the size of the camera. They are rounded to
        8 bits, whether they are kept or not."""
        size = 3 * camera.width * camera.height
        self._planned += size
        fits = self._planned <= self.room
        picture = _Picture(make, _pages(camera.height, camera.width) if fits else None)
        return View(
            name,
            camera,
            cast(Any, lambda: _unit(self._levels(picture).image)),
            cast(Any, lambda: self._levels(picture).mask),
            cast(Any, lambda: None if (a := self._levels(picture).alpha) is None else _unit(a)),
            lens,
        )

    def resized(self, view: View, width: int, height: int) -> View:
        """`View.resized`, made when it is read."""
        if (width, height) == (view.camera.width, view.camera.height):
            return view

        def make() -> Pixels:
            small = view.resized(width, height)
            return Pixels(small.image, small.mask, small.alpha)

        return self.view(view.name, view.camera.resized(width, height), make)

    def framed(self, view: View, width: int, height: int) -> View:
        """The whole view in the middle of a picture of another size, made when it is read: smaller
        if need be, and masked around it. The pose and the direction of each pixel stay."""
        camera = view.camera
        if (width, height) == (camera.width, camera.height):
            return view
        scale = min(1.0, width / camera.width, height / camera.height)
        columns, rows = max(1, int(camera.width * scale)), max(1, int(camera.height * scale))
        left, top = (width - columns) // 2, (height - rows) // 2
        small = camera.resized(columns, rows)
        framed = replace(small, cx=small.cx + left, cy=small.cy + top, width=width, height=height)

        def make() -> Pixels:
            inner, mask = view.resized(columns, rows), torch.zeros(height, width, dtype=torch.bool)
            given = inner.mask
            mask[top : top + rows, left : left + columns] = True if given is None else given
            sides = (left, width - columns - left, top, height - rows - top)
            alpha = inner.alpha
            return Pixels(
                F.pad(inner.image, (0, 0, *sides)),
                mask,
                None if alpha is None else F.pad(alpha, sides),
            )

        return self.view(view.name, framed, make)

    def _levels(self, picture: _Picture) -> _Levels:
        if picture.levels is not None:
            return picture.levels
        last = self._last
        if last is not None and last[0] is picture:  # its image, then its mask
            return last[1]
        levels = _levels(picture.make())
        size = sum(each.nbytes for each in levels if each is not None)
        if size <= self.room and picture.pages is not None:
            image = picture.pages.copy_(levels.image)
            picture.levels, self.room = levels._replace(image=image), self.room - size
        else:
            self._last = picture, levels
        return levels


def of_one_size(dataset: Dataset) -> Dataset:
    """The dataset with its views in pictures of the most frequent size, for what stacks pictures;
    itself where they are of one size. See `PixelCache.framed`."""
    sizes = Counter((view.camera.width, view.camera.height) for view in dataset.views)
    if len(sizes) < 2:
        return dataset
    ((width, height), count), *_ = sizes.most_common(1)
    kept = PixelCache()
    note = (
        f"views of {len(sizes)} sizes: {len(dataset) - count} of {len(dataset)} are framed in "
        f"{width}x{height}"
    )
    return replace(
        dataset,
        views=tuple(kept.framed(view, width, height) for view in dataset.views),
        notes=(*dataset.notes, note),
    )


class _Levels(NamedTuple):
    """`Pixels` in 8 bits."""

    image: UInt8[Tensor, "h w 3"]
    mask: Bool[Tensor, "h w"] | None
    alpha: UInt8[Tensor, "h w"] | None


@dataclass(eq=False)
class _Picture:
    make: Callable[[], Pixels]
    pages: UInt8[Tensor, "h w 3"] | None
    levels: _Levels | None = None


def _pages(height: int, width: int) -> UInt8[Tensor, "{height} {width} 3"]:
    """Room for a picture in pages of its own, which take memory once they are written to. Made
    before pictures are read: what is allocated between the large temporary arrays of reading and
    stays keeps holes of their size open."""
    return torch.frombuffer(mmap(-1, height * width * 3), dtype=torch.uint8).view(height, width, 3)


def _levels(pixels: Pixels) -> _Levels:
    alpha = None if pixels.alpha is None else _bytes(pixels.alpha)
    return _Levels(_bytes(pixels.image), pixels.mask, alpha)


def _bytes(values: Float[Tensor, "*s"]) -> UInt8[Tensor, "*s"]:
    return (values.clamp(0, 1) * 255).round().to(torch.uint8)


def _unit(levels: UInt8[Tensor, "*s"]) -> Float[Tensor, "*s"]:
    return levels.float() / 255
