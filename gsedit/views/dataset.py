"""Pictures with cameras: photos from disk, or renders of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.image_ops import downscale
from gsedit.views.undistort import Lens
from rasterizer.camera import Camera
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

LEAST_SHARE = 1e-4
"""Share of a pixel that a mask must hide for the pixel to be hidden: above what rounding leaves,
and below one masked pixel of a photo that is made 90 times smaller."""


class _Pixels:
    """A field that holds a tensor, or a function that is asked for it each time it is read."""

    def __init__(self, *, optional: bool) -> None:
        self.optional = optional

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = f"_{name}"

    def __get__(self, view: object | None, owner: type) -> Any:
        if view is not None:
            value = view.__dict__[self.name]
            return value() if callable(value) else value
        if self.optional:  # a dataclass asks for the default in this way
            return None
        raise AttributeError(self.name)

    def __set__(self, view: object, value: Any) -> None:
        view.__dict__[self.name] = value


_IMAGE: Any = _Pixels(optional=False)
_MASK: Any = _Pixels(optional=True)
_ALPHA: Any = _Pixels(optional=True)


@dataclass(frozen=True, eq=False, repr=False)
class View:
    """One picture and the camera that took it.

    The pixels of a dataset's photo are read from its file when `image`, `mask` or `alpha` are (see
    gsedit.views.lazy_views): read each once.
    """

    __no_type_check__ = True  # a check of the fields would read all files

    name: str
    camera: Camera
    image: Float[Tensor, "h w 3"] = _IMAGE
    """sRGB in [0, 1]; as many pixels as the camera has. What is transparent is laid over black, as
    renders are."""
    mask: Bool[Tensor, "h w"] | None = _MASK
    """True where the photo says what the scene looks like; None: everywhere. A fit takes nothing
    from the other pixels, and measures nothing there."""
    alpha: Float[Tensor, "h w"] | None = _ALPHA
    """Opacity of the photo, in [0, 1]; None: opaque. Where it is below 1 the scene is to be as
    transparent."""
    lens: Lens | None = None
    """Lens of the photo as it was taken, before its distortion was undone; None: not known."""

    def __repr__(self) -> str:
        return f"View({self.name!r}, {self.camera.width}x{self.camera.height})"

    def seen_by(self, camera: Camera) -> View:
        """View with these pixels and another camera; `replace` would read the picture."""
        view = copy(self)
        object.__setattr__(view, "camera", camera)
        return view

    def over(self, background: Float[Tensor, "3"]) -> Float[Tensor, "h w 3"]:
        """The picture in front of a color, which shows where the photo is transparent."""
        image, alpha = self.image, self.alpha
        return image if alpha is None else image + (1 - alpha)[..., None] * background

    def resized(self, width: int, height: int) -> View:
        """The view on so many pixels, each the mean of those under it; supervised where all are."""
        if (width, height) == (self.camera.width, self.camera.height):
            return self
        image = downscale(self.image, width, height).clamp(0, 1)
        mask, alpha = self.mask, self.alpha
        if mask is not None:
            hidden = downscale((~mask)[..., None].float(), width, height)[..., 0]
            mask = hidden < LEAST_SHARE
        if alpha is not None:
            alpha = downscale(alpha[..., None], width, height)[..., 0].clamp(0, 1)
        return View(self.name, self.camera.resized(width, height), image, mask, alpha)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Posed pictures of one scene, and sparse points of it, if there are any."""

    views: tuple[View, ...]
    points: Float[Tensor, "n 3"] | None = None
    """World positions, in the cameras' frame and units."""
    point_colors: Float[Tensor, "n 3"] | None = None
    """RGB in [0, 1]."""
    source: Path | None = None
    """The folder or file that it was read from."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Vector that was subtracted from the files' world coordinates, because they are far from the
    origin (georeferenced): the files' frame is this one plus the offset."""
    notes: tuple[str, ...] = ()
    """Sentences on how it was read: photos that are missing, sizes, masks."""

    def __len__(self) -> int:
        return len(self.views)

    def split(self, every: int = 8) -> tuple[tuple[View, ...], tuple[View, ...]]:
        """(training, held out): every `every`-th view, counted from the first, is held out."""
        held_out = self.views[::every]
        return tuple(v for i, v in enumerate(self.views) if i % every), held_out


def evenly_spaced(count: int, at_most: int) -> list[int]:
    """At most `at_most` evenly spaced ones of the indices 0 to `count` - 1, 0 among them."""
    number = min(count, at_most)
    return [index * count // number for index in range(number)]


def capture(scene: Gaussians, cameras: Sequence[Camera], names: Sequence[str]) -> tuple[View, ...]:
    """Renders of a scene as views, clamped to [0, 1]; one name for each camera."""
    return tuple(
        View(name, camera, render_picture(scene, camera))
        for name, camera in zip(names, cameras, strict=True)
    )
