"""Lens distortion undone: the picture that an ideal pinhole camera would have taken.

Brown-Conrady model as in OpenCV and COLMAP's OPENCV. On the plane z = 1, r^2 = x^2 + y^2,
  x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y_d alike.
Every pixel centre (u + 0.5, v + 0.5) of the pinhole picture looks up its distorted position in the
photo: the forward model, which is a formula; its inverse, an iteration, is never needed.

kornia computes the formula. Its `undistort_image` keeps the focal length, so that borders become
black; pycolmap's `undistort_image` takes and returns 8-bit pictures, and changes their size. Both
compute their map for every photo anew and take three to six times as long as `undistort`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from rasterizer.camera import Camera

_ZOOM_MAX = 8.0  # a lens that needs more keeps less than 1/64 of the photo: a fisheye, or nonsense
_BISECTIONS = 40  # of [1, 8]: far below the last digit of a float32 pixel position


@dataclass(frozen=True)
class Lens:
    """Intrinsics of a photo: pixels, the corner of the first one at (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def is_pinhole(self) -> bool:
        return not any((self.k1, self.k2, self.k3, self.p1, self.p2))

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

    "Inside" is between the centres of the photo's border pixels, so no value is extrapolated. The
    zoom is the smallest one >= 1 (to bisection accuracy), the same for x and y. Raises InputError
    where no zoom up to 8 will do.
    """
    if lens.is_pinhole:
        return Undistortion(lens, None)
    ideal = lens.zoomed(_smallest_zoom(lens))
    return Undistortion(ideal, distort(ideal.camera(torch.eye(4)).pixel_centres(), ideal, lens))


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
    """From positions in the ideal lens's picture to positions in the photo of `lens`, pixels."""
    from kornia.geometry.calibration import distort_points

    coefficients = torch.tensor([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3], dtype=xy.dtype)
    flat = distort_points(
        xy.reshape(-1, 2), _matrix(lens, xy.dtype), coefficients, _matrix(ideal, xy.dtype)
    )
    return flat.reshape(xy.shape)


def _smallest_zoom(lens: Lens) -> float:
    """By bisection, in [1, 8]. Raises InputError where 8 is not enough."""
    low, high = 1.0, _ZOOM_MAX
    if _stays_inside(lens, low):
        return low
    if not _stays_inside(lens, high):
        raise InputError(
            f"lens distortion k1 {lens.k1:g}, k2 {lens.k2:g}, k3 {lens.k3:g}, p1 {lens.p1:g}, "
            f"p2 {lens.p2:g} leaves no picture: calibrate again, or undistort with COLMAP"
        )
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if _stays_inside(lens, middle) else (middle, high)
    return high


def _stays_inside(lens: Lens, zoom: float) -> bool:
    """Whether no pixel of the zoomed picture looks outside the photo.

    It is enough that its border looks inside and that the distorted radius grows with the ideal one
    up to the corners: else one point of the photo would appear twice.
    """
    ideal = lens.zoomed(zoom)
    border = _border_centres(lens.width, lens.height)
    distorted = distort(border, ideal, lens)
    last = torch.tensor([lens.width - 0.5, lens.height - 0.5], dtype=distorted.dtype)
    # centres map to themselves only to rounding: allow 1e-9 pixels
    inside = bool(((distorted >= 0.5 - 1e-9) & (distorted <= last + 1e-9)).all())
    offset = (border - torch.tensor([lens.cx, lens.cy])) / torch.tensor([ideal.fx, ideal.fy])
    r2 = torch.linspace(0, float(offset.square().sum(-1).max()), 257, dtype=torch.float64)
    slope = 1 + r2 * (3 * lens.k1 + r2 * (5 * lens.k2 + r2 * 7 * lens.k3))
    return inside and bool((slope > 0).all())


def _border_centres(width: int, height: int) -> Float[Tensor, "n 2"]:
    x = torch.arange(width, dtype=torch.float64) + 0.5
    y = torch.arange(height, dtype=torch.float64) + 0.5
    rows = [torch.cartesian_prod(x, side) for side in (y[:1], y[-1:])]
    columns = [torch.cartesian_prod(side, y) for side in (x[:1], x[-1:])]
    return torch.cat((*rows, *columns))


def _matrix(lens: Lens, dtype: torch.dtype) -> Float[Tensor, "3 3"]:
    """The intrinsic matrix K."""
    rows = [[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]]
    return torch.tensor(rows, dtype=dtype)
