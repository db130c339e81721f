"""Lens distortion undone: the picture that an ideal pinhole camera would have taken.

Brown-Conrady model as in OpenCV and COLMAP's OPENCV. On the plane z = 1, r^2 = x^2 + y^2,
  x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y_d alike.
Every pixel center (u + 0.5, v + 0.5) of the pinhole picture looks up its distorted position in the
photo: the forward model, which is a formula; its inverse, an iteration, is never needed.

pycolmap's `Camera.img_from_cam` computes it for these lenses and for all others (fisheyes, ...); it
starts no threads. Neither its `undistort_image` nor kornia's does the rest: kornia's keeps the
focal length, so that borders become black, and knows no fisheye; pycolmap's takes and returns 8-bit
pictures, and changes their size. Both compute their map for every photo anew.
"""

from __future__ import annotations

import signal
import threading
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from rasterizer.camera import Camera

_STEPS, _EVERY = 65, 16  # along lines from the center to every 16th border pixel: 65 positions


class ColmapLens(NamedTuple):
    """A camera model of COLMAP with its parameters, for photos of the size of the calibration."""

    model: str
    params: tuple[float, ...]
    width: int
    height: int


@dataclass(frozen=True)
class Lens:
    """Intrinsics of a photo: pixels, the corner of the first one at (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distorted: ColmapLens | None = None
    """How it bends rays; None: not at all."""

    def bent(
        self, k1: float = 0.0, k2: float = 0.0, p1: float = 0.0, p2: float = 0.0, k3: float = 0.0
    ) -> Lens:
        """The lens with these coefficients of Brown and Conrady; itself where all are 0."""
        if not any((k1, k2, p1, p2, k3)):
            return self
        params = (self.fx, self.fy, self.cx, self.cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)
        return replace(self, distorted=ColmapLens("FULL_OPENCV", params, self.width, self.height))

    def scaled(self, width: int, height: int) -> Lens:
        """The lens of the same photo on another number of pixels."""
        x, y = width / self.width, height / self.height
        focal = {"fx": self.fx * x, "fy": self.fy * y}
        return replace(self, **focal, cx=self.cx * x, cy=self.cy * y, width=width, height=height)

    def camera(self, world_to_camera: Float[Tensor, "4 4"]) -> Camera:
        """The pinhole camera with these intrinsics: the distortion must be undone already."""
        size = (self.width, self.height)
        return Camera(world_to_camera, self.fx, self.fy, self.cx, self.cy, *size)

    def zoomed(self, zoom: float) -> Lens:
        """The ideal lens at the same place with `zoom` times the focal length."""
        size = (self.width, self.height)
        return Lens(self.fx * zoom, self.fy * zoom, self.cx, self.cy, *size)


class Undistortion(NamedTuple):
    """How the distortion of a lens is undone; the same for all its photos."""

    lens: Lens
    """The ideal lens of the new pictures: same size and principal point, focal length not less."""
    lookup: Float[Tensor, "h w 2"] | None
    """Position in the photo that each new pixel looks up, pixels; None: no distortion."""


def undistortion(lens: Lens) -> Undistortion:
    """The ideal lens, zoomed in just enough that no pixel looks outside the photo.

    "Inside" is between the centers of the photo's border pixels, so no value is extrapolated. The
    zoom is the smallest one >= 1 (to bisection accuracy), the same for x and y. Raises InputError
    where no zoom up to 8 will do.
    """
    ideal = ideal_lens(lens)
    if ideal is lens:
        return Undistortion(lens, None)
    return Undistortion(ideal, distort(ideal.camera(torch.eye(4)).pixel_centers(), ideal, lens))


def ideal_lens(lens: Lens) -> Lens:
    """The lens of the undistorted pictures, see `undistortion`; `lens` itself if a pinhole."""
    return lens if lens.distorted is None else lens.zoomed(_smallest_zoom(lens.distorted, lens))


def undistort(photo: Float[Tensor, "h w c"], undo: Undistortion) -> Float[Tensor, "h w c"]:
    """Sample the photo bilinearly where the map says; without distortion, the photo itself."""
    if undo.lookup is None:
        return photo
    size = torch.tensor([undo.lens.width, undo.lens.height], dtype=torch.float64)
    # align_corners=False: -1 and 1 are the outer corners of the picture, our 0 and size
    grid = (2 * undo.lookup / size - 1).to(photo)
    sampled = torch.nn.functional.grid_sample(
        photo.permute(2, 0, 1)[None], grid[None], padding_mode="border", align_corners=False
    )
    return sampled[0].permute(1, 2, 0).contiguous()


def distort(xy: Float[Tensor, "*b 2"], ideal: Lens, lens: Lens) -> Float[Tensor, "*b 2"]:
    """From positions in the ideal lens's picture to positions in the photo of `lens`, pixels.

    pycolmap's pixels begin at the corner as ours do. NaN where the lens shows no such direction.
    """
    model = lens.distorted
    if model is None:
        return xy
    camera = import_pycolmap().Camera(
        model=model.model, width=model.width, height=model.height, params=list(model.params)
    )
    center = torch.tensor([ideal.cx, ideal.cy], dtype=torch.float64)
    focal = torch.tensor([ideal.fx, ideal.fy], dtype=torch.float64)
    rays = ((xy.double() - center) / focal).reshape(-1, 2)
    rays = torch.cat((rays, torch.ones(len(rays), 1, dtype=torch.float64)), 1)
    found = torch.from_numpy(camera.img_from_cam(rays.numpy()))
    size = torch.tensor([lens.width / model.width, lens.height / model.height]).double()
    return (found * size).reshape(xy.shape).to(xy.dtype)


def _smallest_zoom(model: ColmapLens, lens: Lens) -> float:
    """By bisection, in [1, 8]. Raises InputError where 8 is not enough, as for a fisheye: less than
    1/64 of the photo would be left."""
    low, high = 1.0, 8.0
    if _stays_inside(lens, low):
        return low
    if not _stays_inside(lens, high):
        params = ", ".join(f"{value:g}" for value in model.params)
        raise InputError(
            f"lens distortion {model.model} {params} leaves no picture: calibrate again, or "
            "undistort with COLMAP"
        )
    for _ in range(40):  # below the last digit of a position
        middle = (low + high) / 2
        low, high = (low, middle) if _stays_inside(lens, middle) else (middle, high)
    return high


def _stays_inside(lens: Lens, zoom: float) -> bool:
    """Whether no pixel of the zoomed picture looks outside the photo.

    It is enough that its border looks inside and that the distorted radius grows with the ideal one
    up to the corners: else one point of the photo would appear twice.
    """
    ideal = lens.zoomed(zoom)
    border = _border_centers(lens.width, lens.height)
    distorted = distort(border, ideal, lens)
    last = torch.tensor([lens.width - 0.5, lens.height - 0.5], dtype=distorted.dtype)
    # centers map to themselves only to rounding: allow 1e-9 pixels
    inside = bool(((distorted >= 0.5 - 1e-9) & (distorted <= last + 1e-9)).all())
    return inside and _grows(lens, ideal, border)


def _grows(lens: Lens, ideal: Lens, border: Float[Tensor, "n 2"]) -> bool:
    """Whether what is further from the center of the ideal picture is so in the photo too."""
    center = torch.tensor([ideal.cx, ideal.cy], dtype=torch.float64)
    steps = torch.linspace(0, 1, _STEPS, dtype=torch.float64)[:, None, None]
    found = distort(center + steps * (border[::_EVERY] - center), ideal, lens)
    radius = (found - found[0]).norm(dim=-1)
    return bool((radius.diff(dim=0) > 0).all())


def _border_centers(width: int, height: int) -> Float[Tensor, "n 2"]:
    x = torch.arange(width, dtype=torch.float64) + 0.5
    y = torch.arange(height, dtype=torch.float64) + 0.5
    rows = [torch.cartesian_prod(x, side) for side in (y[:1], y[-1:])]
    columns = [torch.cartesian_prod(side, y) for side in (x[:1], x[-1:])]
    return torch.cat((*rows, *columns))


def import_pycolmap() -> Any:
    """The module pycolmap. Its logging library (glog) takes SIGTERM over and ends the process with
    a stack trace: the handler that was there before is put back, so that work can keep what is
    done."""
    before = signal.getsignal(signal.SIGTERM)
    import pycolmap

    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)
    return pycolmap
