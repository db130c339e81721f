"""Color grading: the sliders of a photo editor, on display colors (sRGB).

All but the curve are affine in display colors, and so exact from every direction and in every
picture. What is done in linear light is done on a display of gamma 2.2: a factor f of the light is
a factor f^(1/2.2) of the display color.

Maps of colors are done to scenes whose colors depend on the direction they are seen from:
`n` Gaussians, `k` SH coefficients a channel, `m` colors, `d` directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, isqrt

import numpy as np
from jaxtyping import Float32, Float64

from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE, XYZ_OF_RGB
from gsedit.scene.quaternions import axis_rotation, even_directions, harmonics
from rasterizer.numerics import SH_DC

ColorMap = Callable[[Float64[np.ndarray, "m 3"]], Float64[np.ndarray, "m 3"]]
"""From display colors (sRGB, about [0, 1]) to display colors."""

SEEN_FROM = 2
"""Directions, as many times as there are coefficients, in which a map is done to a color."""


@dataclass(frozen=True, eq=False)
class Affine:
    """color -> matrix color + offset."""

    matrix: Float64[np.ndarray, "3 3"]
    offset: Float64[np.ndarray, "3"]

    def __call__(self, colors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        return colors @ self.matrix.T + self.offset

    def then(self, other: Affine) -> Affine:
        """This one first, then the other."""
        return Affine(other.matrix @ self.matrix, other.matrix @ self.offset + other.offset)


def mapped(sh: Float32[np.ndarray, "n k 3"], color_map: ColorMap) -> Float32[np.ndarray, "n k 3"]:
    """The coefficients of Gaussians after a map of their colors.

    An affine map is done exactly, from every direction: its matrix acts on every coefficient, its
    offset on the first. Any other is done to the colors in `SEEN_FROM` k even directions, and what
    that changes is fitted by harmonics of the same degree; colors below 0 are mapped as 0, which
    is how they are drawn.
    """
    n, k, _ = sh.shape
    if isinstance(color_map, Affine):
        after = sh.astype(np.float64) @ color_map.matrix.T
        grey = np.full(3, 0.5)
        after[:, 0] += (color_map(grey[None])[0] - grey) / SH_DC
        return after.astype(np.float32)
    values, fit = _seen(isqrt(k) - 1)
    after = np.empty_like(sh)
    rows = max(1, (1 << 19) // len(values))  # colors at a time: 12 MB
    for start in range(0, n, rows):
        before = sh[start : start + rows].astype(np.float64)
        colors = np.maximum(0.5 + np.einsum("dk,nkc->ndc", values, before), 0)
        moved = color_map(colors.reshape(-1, 3)).reshape(colors.shape)
        after[start : start + rows] = before + np.einsum("kd,ndc->nkc", fit, moved - colors)
    return after


@lru_cache(4)
def _seen(degree: int) -> tuple[Float64[np.ndarray, "d k"], Float64[np.ndarray, "k d"]]:
    """(harmonics in even directions, their pseudo-inverse)."""
    count = 1 if degree == 0 else SEEN_FROM * (degree + 1) ** 2
    values = harmonics(even_directions(count), degree)
    return values, np.linalg.pinv(values)


def as_table(color_map: ColorMap, side: int = 33) -> ColorMap:
    """A map that takes long, by a cube of `side`^3 colors of [0, 1]: linear between them."""
    from scipy.ndimage import map_coordinates

    axis = np.linspace(0, 1, side)
    corners = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    grid = color_map(corners.reshape(-1, 3)).reshape(corners.shape)

    def looked_up(colors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        places = np.clip(colors, 0, 1).T * (side - 1)
        channels = np.moveaxis(grid, -1, 0)
        return np.stack([map_coordinates(each, places, order=1) for each in channels], -1)

    return looked_up


GAMMA = 2.2
"""Exponent of the display: turns a factor of light into a factor of display colors."""
NEUTRAL = 6500.0
"""Kelvin; D65, the white of sRGB, nearly."""
COLDEST, HOTTEST = 1667.0, 25000.0
"""Kelvin, where the locus below holds."""
GREY = 0.5
"""Display color that contrast keeps."""

CurvePoints = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Grade:
    """A grading of colors, in this order. Raises UsageError for a value out of range."""

    temperature: float = NEUTRAL
    """Kelvin of the light that the capture is taken to be under, as in a photo editor: above 6500
    the picture becomes warmer, below colder. Luminance is kept."""
    tint: float = 0.0
    """Stops that green loses against red and blue: above 0 towards magenta, below towards green.
    Luminance is kept."""
    exposure: float = 0.0
    """Stops: light times 2^exposure."""
    contrast: float = 1.0
    """Factor of the distance from mid-grey; 1 changes nothing."""
    saturation: float = 1.0
    """Factor of the distance from the grey of the same luma (Rec. 709); 0 is black and white."""
    hue: float = 0.0
    """Degrees about the grey axis, red towards green."""
    curve: CurvePoints = ()
    """Points (before, after) of a monotone curve of each channel; (0, 0) and (1, 1) where no point
    has that place."""

    def __post_init__(self) -> None:
        numbers = {name: value for name, value in vars(self).items() if name != "curve"}
        for name, value in numbers.items():
            if not isfinite(value):
                raise UsageError(f"{name} is {value}: give a finite number")
        if not COLDEST <= self.temperature <= HOTTEST:
            raise UsageError(
                f"temperature {self.temperature:g}: give kelvin, 1667 (blue) to 25000 (orange); "
                "6500 changes nothing"
            )
        for name, most in (("exposure", 20), ("tint", 4)):
            if abs(numbers[name]) > most:
                raise UsageError(f"{name} {numbers[name]:g}: give stops, -{most} to {most}")
        for name in ("contrast", "saturation"):
            if numbers[name] < 0:
                raise UsageError(f"{name} {numbers[name]:g}: give a factor of 0 or more")
        check_curve(self.curve)

    @property
    def affine(self) -> Affine:
        """All but the curve."""
        gains = self._gains() ** (1 / GAMMA)
        luma = np.broadcast_to(LUMINANCE, (3, 3))
        greyed = self.saturation * np.eye(3) + (1 - self.saturation) * luma
        zero, offset = np.zeros(3), np.full(3, GREY * (1 - self.contrast))
        lit = Affine(np.diag(gains), zero).then(Affine(self.contrast * np.eye(3), offset))
        turned = axis_rotation(np.ones(3), self.hue)  # about the grey axis
        return lit.then(Affine(greyed, zero)).then(Affine(turned, zero))

    def _gains(self) -> Float64[np.ndarray, "3"]:
        """Factors of linear red, green and blue."""
        warm = white(NEUTRAL) / white(self.temperature)
        warm[1] *= 2**-self.tint
        return 2**self.exposure * warm * LUMINANCE.sum() / (LUMINANCE @ warm)

    def __call__(self, colors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        """The graded colors, not clipped."""
        return curved(self.affine(colors), self.curve)


def white(kelvin: float) -> Float64[np.ndarray, "3"]:
    """Linear sRGB of a black body's light, of luminance 1: the Planckian locus (Kim et al. 2002,
    US patent 7024034), within [1667, 25000] K."""
    t = 1000 / kelvin
    if kelvin <= 4000:
        x = -0.2661239 * t**3 - 0.2343589 * t**2 + 0.8776956 * t + 0.179910
    else:
        x = -3.0258469 * t**3 + 2.1070379 * t**2 + 0.2226347 * t + 0.240390
    if kelvin <= 2222:
        y = -1.1063814 * x**3 - 1.34811020 * x**2 + 2.18555832 * x - 0.20219683
    elif kelvin <= 4000:
        y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    else:
        y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
    rgb = np.linalg.solve(XYZ_OF_RGB, np.array([x / y, 1.0, (1 - x - y) / y]))
    return np.maximum(rgb, 1e-2)  # below about 1900 K, blue is outside sRGB


def curved(colors: Float64[np.ndarray, "m 3"], points: CurvePoints) -> Float64[np.ndarray, "m 3"]:
    """The curve of each channel: through the points, monotone between them (PCHIP; Fritsch and
    Butland 1984). Outside [0, 1] colors are shifted as its end is."""
    if not points:
        return colors
    from scipy.interpolate import PchipInterpolator

    inside = np.clip(colors, 0, 1)
    return PchipInterpolator(*np.array(with_ends(points)).T)(inside) + colors - inside


def with_ends(points: CurvePoints) -> CurvePoints:
    """The points in order, with (0, 0) and (1, 1) where no point has that place."""
    return tuple(sorted({0.0: 0.0, 1.0: 1.0, **dict(points)}.items()))


def check_curve(points: CurvePoints) -> None:
    """Raise UsageError for points that are no rising curve in [0, 1]."""
    places = [x for x, _ in points]
    if any(not 0 <= value <= 1 for point in points for value in point):
        raise UsageError(f"curve {curve_text(points)}: all numbers must be from 0 to 1")
    if len(set(places)) < len(places):
        raise UsageError(f"curve {curve_text(points)}: two points have one place")
    heights = [y for _, y in with_ends(points)] if points else []
    if heights != sorted(heights):
        raise UsageError(
            f"curve {curve_text(points)}: falls; each point must be as high as the one before it "
            "(0:0 and 1:1 are added where no point is at 0 or 1)"
        )


def parse_curve(text: str) -> CurvePoints:
    """Points as in `0:0.1,0.5:0.6`. Raises UsageError."""
    try:
        pairs = [tuple(float(number) for number in each.split(":")) for each in text.split(",")]
        points = tuple((x, y) for x, y in pairs)
    except ValueError:
        raise UsageError(
            f"curve {text}: give points BEFORE:AFTER between 0 and 1, as in 0:0.1,0.5:0.6"
        ) from None
    return points


def curve_text(points: CurvePoints) -> str:
    """The points as `parse_curve` reads them."""
    return ",".join(f"{x:g}:{y:g}" for x, y in points)
