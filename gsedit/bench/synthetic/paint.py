"""Colors by position: closures from points to rgb, the same from every side.

All patterns are smooth, with wavelengths that a picture of some 128 pixels resolves, so that
photometric tests measure the method and not the aliasing.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.synthetic.shapes import Points, Sdf, Triple, gradient

Colors: TypeAlias = Float[Tensor, "*b 3"]
"""RGB in [0, 1]."""
Paint: TypeAlias = Callable[[Points], Colors]
"""The color at points: the albedo."""
Shares: TypeAlias = Float[Tensor, "*b"]
"""Shares in the range [0, 1]."""
Pattern: TypeAlias = Callable[[Points], Shares]
"""The share of a second paint at points."""

OCCLUSION_REACH = (0.03, 0.08, 0.18)  # world units: contact, crease and hollow of scenes of size 1


def plain(color: Triple) -> Paint:
    """Paint with one color everywhere."""

    def paint(points: Points) -> Colors:
        return points.new_tensor(color).expand(points.shape)

    return paint


def mix(first: Paint, second: Paint, share: Pattern) -> Paint:
    """The second paint where `share` (in [0, 1], by position) is 1, the first where it is 0."""

    def paint(points: Points) -> Colors:
        weight = share(points)[..., None]
        return first(points) * (1 - weight) + second(points) * weight

    return paint


def stripes(direction: Triple, period: float, sharpness: float = 1.0) -> Pattern:
    """A share that alternates along `direction` (unit length); sharper edges above 1."""

    def share(points: Points) -> Shares:
        phase = points @ points.new_tensor(direction) * (2 * pi / period)
        return 0.5 + 0.5 * _steepen(phase.sin(), sharpness)

    return share


def checker(period: float, sharpness: float = 3.0) -> Pattern:
    """A share of 1 and 0 in alternate cubes of side `period / 2`, with soft faces."""

    def share(points: Points) -> Shares:
        # a phase off the origin: no face of the pattern lies in a scene's coordinate planes
        waves = (points * (2 * pi / period) + pi / 4).sin()
        return 0.5 + 0.5 * _steepen(2 * waves.prod(-1), sharpness)

    return share


def waves(period: float) -> Pattern:
    """A share like a soft marbling: four plane waves that never repeat together."""
    directions = ((0.8, 0.5, 0.33), (-0.44, 0.83, 0.35), (0.36, -0.48, 0.8), (0.61, 0.2, -0.77))
    frequencies = (1.0, 1.31, 1.73, 2.17)  # ratios of no small integers

    def share(points: Points) -> Shares:
        total = points.new_zeros(points.shape[:-1])
        for direction, frequency in zip(directions, frequencies):
            phase = points @ points.new_tensor(direction)
            total = total + (phase * (2 * pi * frequency / period) + 3 * frequency).sin()
        return 0.5 + total / 8

    return share


def tiles(period: float, joint: float) -> Pattern:
    """A share of 1 on square slabs in the xy plane and 0 in the joints of width `joint`."""

    def share(points: Points) -> Shares:
        # the phase of `checker(2 * period)`, so that its colors change in the joints
        off_center = ((points[..., :2] / period + 0.25) % 1 - 0.5).abs() * period
        to_joint = 0.5 * period - off_center.amax(-1)
        return (to_joint / joint - 0.5).clamp(0, 1)

    return share


def parts(*painted: tuple[Sdf, Paint], blend: float = 0.008) -> Paint:
    """Each solid in its own paint: a point takes the paint of the nearest solid.

    Within about `blend` world units of two solids their paints are mixed.
    """

    def paint(points: Points) -> Colors:
        distances = torch.stack([solid(points) for solid, _ in painted], -1)
        shares = (-distances / blend).softmax(-1).unbind(-1)
        layers = [s[..., None] * coat(points) for s, (_, coat) in zip(shares, painted)]
        return torch.stack(layers).sum(0)

    return paint


def lit(coat: Paint, solid: Sdf, light: Triple, ambient: float = 0.55) -> Paint:
    """The paint under diffuse light from the direction `light`, darker where the solid occludes it.

    Baked by position and normal only, so the color still is the same from every side. `ambient` is
    the brightness on the side away from the light; ambient occlusion (Quilez) darkens creases by a
    factor of up to 0.6 for each of the distances OCCLUSION_REACH.
    """

    def paint(points: Points) -> Colors:
        direction = torch.nn.functional.normalize(points.new_tensor(light), dim=0)
        normals = torch.nn.functional.normalize(gradient(solid, points), dim=-1)
        facing = 0.5 + 0.5 * (normals @ direction)  # wrapped: no hard edge between light and shade
        openness = torch.ones_like(facing)
        for reach in OCCLUSION_REACH:
            clearance = solid(points + reach * normals) / reach
            openness = openness * (0.6 + 0.4 * clearance.clamp(0, 1))
        shade = (ambient + (1 - ambient) * facing) * openness
        return (coat(points) * shade[..., None]).clamp(0, 1)

    return paint


def _steepen(wave: Shares, sharpness: float) -> Shares:
    """A wave in [-1, 1] with steeper flanks and flatter tops; 1 leaves it (nearly) alone."""
    return (sharpness * wave).tanh() / torch.tanh(wave.new_tensor(sharpness))
