"""Colours by position: closures from points to rgb, the same from every side.

All patterns are smooth, with wavelengths that a picture of some 128 pixels resolves, so that
photometric tests measure the method and not the aliasing.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TypeAlias

import torch
from torch import Tensor

from gsedit.synthetic.shapes import Sdf, Triple, gradient

Paint: TypeAlias = Callable[[Tensor], Tensor]
"""Points `*b 3`, world units -> rgb `*b 3` in [0, 1]."""

OCCLUSION_REACH = (0.03, 0.08, 0.18)  # world units: contact, crease and hollow of scenes of size 1


def plain(color: Triple) -> Paint:
    def paint(points: Tensor) -> Tensor:
        return points.new_tensor(color).expand(points.shape)

    return paint


def mix(first: Paint, second: Paint, share: Callable[[Tensor], Tensor]) -> Paint:
    """The second paint where `share` (in [0, 1], by position) is 1, the first where it is 0."""

    def paint(points: Tensor) -> Tensor:
        weight = share(points)[..., None]
        return first(points) * (1 - weight) + second(points) * weight

    return paint


def stripes(direction: Triple, period: float, sharpness: float = 1.0) -> Callable[[Tensor], Tensor]:
    """A share that alternates along `direction` (unit length); sharper edges above 1."""

    def share(points: Tensor) -> Tensor:
        phase = points @ points.new_tensor(direction) * (2 * pi / period)
        return 0.5 + 0.5 * _flatten(phase.sin(), sharpness)

    return share


def checker(period: float, sharpness: float = 3.0) -> Callable[[Tensor], Tensor]:
    """A share of 1 and 0 in alternate cubes of side `period / 2`, with soft faces."""

    def share(points: Tensor) -> Tensor:
        # a phase off the origin: no face of the pattern lies in a scene's coordinate planes
        waves = (points * (2 * pi / period) + pi / 4).sin()
        return 0.5 + 0.5 * _flatten(2 * waves.prod(-1), sharpness)

    return share


def waves(period: float) -> Callable[[Tensor], Tensor]:
    """A share like a soft marbling: four plane waves that never repeat together."""
    directions = ((0.8, 0.5, 0.33), (-0.44, 0.83, 0.35), (0.36, -0.48, 0.8), (0.61, 0.2, -0.77))
    frequencies = (1.0, 1.31, 1.73, 2.17)  # ratios of no small integers

    def share(points: Tensor) -> Tensor:
        total = points.new_zeros(points.shape[:-1])
        for direction, frequency in zip(directions, frequencies):
            phase = points @ points.new_tensor(direction)
            total = total + (phase * (2 * pi * frequency / period) + 3 * frequency).sin()
        return 0.5 + total / 8

    return share


def tiles(period: float, joint: float) -> Callable[[Tensor], Tensor]:
    """A share of 1 on square slabs in the xy plane and 0 in the joints of width `joint`."""

    def share(points: Tensor) -> Tensor:
        # the phase of `checker(2 * period)`, so that its colours change in the joints
        off_centre = ((points[..., :2] / period + 0.25) % 1 - 0.5).abs() * period
        to_joint = 0.5 * period - off_centre.amax(-1)
        return (to_joint / joint - 0.5).clamp(0, 1)

    return share


def parts(*painted: tuple[Sdf, Paint], blend: float = 0.008) -> Paint:
    """Each solid in its own paint: a point takes the nearest one's, softly within `blend`."""

    def paint(points: Tensor) -> Tensor:
        distances = torch.stack([solid(points) for solid, _ in painted], -1)
        shares = (-distances / blend).softmax(-1).unbind(-1)
        layers = [s[..., None] * coat(points) for s, (_, coat) in zip(shares, painted)]
        return torch.stack(layers).sum(0)

    return paint


def lit(coat: Paint, solid: Sdf, light: Triple, ambient: float = 0.55) -> Paint:
    """The paint under a soft light from a direction, darker where the solid shuts out the sky.

    Baked by position and normal only, so the colour still is the same from everywhere. `ambient` is
    the brightness on the side away from the light; creases lose up to as much again.
    """

    def paint(points: Tensor) -> Tensor:
        towards = torch.nn.functional.normalize(points.new_tensor(light), dim=0)
        normals = torch.nn.functional.normalize(gradient(solid, points), dim=-1)
        facing = 0.5 + 0.5 * (normals @ towards)  # wrapped: no hard edge between light and shade
        openness = torch.ones_like(facing)
        for reach in OCCLUSION_REACH:
            room = solid(points + reach * normals) / reach
            openness = openness * (0.6 + 0.4 * room.clamp(0, 1))
        shade = (ambient + (1 - ambient) * facing) * openness
        return (coat(points) * shade[..., None]).clamp(0, 1)

    return paint


def _flatten(wave: Tensor, sharpness: float) -> Tensor:
    """A wave in [-1, 1] with steeper flanks and flatter tops; 1 leaves it (nearly) alone."""
    return (sharpness * wave).tanh() / torch.tanh(wave.new_tensor(sharpness))
