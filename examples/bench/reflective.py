"""Exact pictures of one solid in a known surrounding: metal, gloss and matte paint, path traced.

The surrounding is light on a sphere around the scene. A surface reflects by GGX with Smith's
shadowing and Schlick's Fresnel term; the solid shadows itself, and sees itself once. Linear light;
pictures are display colors, clipped at 1. `m` points or rays, `s` samples of each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import Sdf, Triple, gradient
from gsedit.bench.synthetic.splats import surface_gaussians, surface_points
from gsedit.scene.color_space import linear_of_srgb, srgb_of_linear
from gsedit.scene.quaternions import even_directions
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians, concatenate

Light = Callable[[Float[Tensor, "*m 3"]], Float[Tensor, "*m 3"]]
"""Linear light from unit directions."""

DOME = 6.0
"""Radius of the surrounding sphere, in radii of the scene."""
LIFT = 1e-3
"""Distance, in radii of the scene, at which a reflected ray starts off its surface."""
OVERSTEP = 2e-3
"""Overstep of sphere tracing, in radii of the scene: coarser than for first hits."""


@dataclass(frozen=True)
class Finish:
    """How the solid reflects, everywhere or at a point."""

    base: Callable[[Float[Tensor, "m 3"]], Float[Tensor, "m 3"]]
    """Linear base color at points: albedo of what is no metal, reflectance of metal head on."""
    metalness: float = 0.0
    roughness: float = 0.5
    """GGX's alpha is its square."""
    specular: float = 0.04
    """Reflectance head on of what is no metal."""


@dataclass(frozen=True, eq=False)
class LitSolid:
    """A solid within a ball around the origin, and the light on a sphere around it."""

    solid: SyntheticScene
    light: Light

    @property
    def radius(self) -> float:
        """Radius of the sphere that carries the light, world units."""
        return DOME * self.solid.radius

    def photograph(
        self, finish: Finish, camera: Camera, samples: int = 32, supersample: int = 2
    ) -> Float[Tensor, "h w 3"]:
        """The exact picture of the solid with a finish, before its surrounding; display colors.

        The mean of `supersample`^2 sub-pixels of `samples` rays for each kind of reflection.
        """
        size = (camera.height, supersample, camera.width, supersample, 3)
        camera = camera.resized(camera.width * supersample, camera.height * supersample)
        traced = self.solid.trace(camera)
        eye = camera.center.double()
        xy = camera.pixel_centers()
        rays = camera.unproject(xy, torch.ones(xy.shape[:2], dtype=torch.float64)) - eye
        rays = torch.nn.functional.normalize(rays, dim=-1)
        hit = traced.hit
        image = self.dome(eye.expand_as(rays), rays)
        points = camera.unproject(xy[hit], traced.depth[hit])
        image[hit] = self.outgoing(finish, points, traced.normal[hit], -rays[hit], samples)
        return display(image.clamp(0, 1).reshape(size).mean((1, 3)))

    def outgoing(
        self,
        finish: Finish,
        points: Float[Tensor, "m 3"],
        normals: Float[Tensor, "m 3"],
        views: Float[Tensor, "m 3"],
        samples: int = 32,
        deep: bool = True,
    ) -> Float[Tensor, "m 3"]:
        """Linear light that points send in the directions `views`."""
        base = finish.base(points)
        f0 = finish.specular + (base - finish.specular) * finish.metalness
        total = torch.zeros_like(points)
        if finish.metalness < 1:
            incoming = self._gathered(finish, points, normals, _cosine(normals, samples), deep)
            total += (1 - finish.metalness) * base * incoming.mean(1)
        halfway = _microfacets(normals, finish.roughness, samples)
        views = views[:, None].expand_as(halfway)
        along = (views * halfway).sum(-1, keepdim=True)
        directions = 2 * along * halfway - views
        incoming = self._gathered(finish, points, normals, directions, deep)
        up = normals[:, None]
        in_cos, out_cos, half_cos = (
            (up * each).sum(-1, keepdim=True) for each in (directions, views, halfway)
        )
        fresnel = f0[:, None] + (1 - f0[:, None]) * (1 - along.clamp(0, 1)) ** 5
        shadowed = _smith(in_cos, finish.roughness) * _smith(out_cos, finish.roughness)
        weight = fresnel * shadowed * along.clamp_min(0) / (out_cos * half_cos).clamp_min(1e-3)
        return total + (incoming * weight * (in_cos > 0)).mean(1)

    def dome(
        self, origins: Float[Tensor, "*m 3"], directions: Float[Tensor, "*m 3"]
    ) -> Float[Tensor, "*m 3"]:
        """Light of the surrounding along rays from inside it."""
        along = (origins * directions).sum(-1, keepdim=True)
        rest = self.radius**2 - origins.square().sum(-1, keepdim=True)
        points = origins + (-along + (along.square() + rest).sqrt()) * directions
        return self.light(points / self.radius)

    def _gathered(
        self,
        finish: Finish,
        points: Float[Tensor, "m 3"],
        normals: Float[Tensor, "m 3"],
        directions: Float[Tensor, "m s 3"],
        deep: bool,
    ) -> Float[Tensor, "m s 3"]:
        """Light that arrives along directions: of the surrounding, or of the solid itself."""
        starts = (points + LIFT * self.solid.radius * normals)[:, None].expand_as(directions)
        starts, rays = starts.reshape(-1, 3), directions.reshape(-1, 3)
        light = self.dome(starts, rays)
        if deep:
            away = hits(self.solid.sdf, starts, rays, 2 * self.solid.radius, self.solid.radius)
            own = away.isfinite()
            met = starts[own] + away[own, None] * rays[own]
            facing = torch.nn.functional.normalize(gradient(self.solid.sdf, met), dim=-1)
            light[own] = self.outgoing(finish, met, facing, -rays[own], 4, deep=False)
        return light.reshape(directions.shape)


def hits(
    sdf: Sdf,
    origins: Float[Tensor, "m 3"],
    directions: Float[Tensor, "m 3"],
    far: float,
    radius: float,
) -> Float[Tensor, " m"]:
    """Distances at which rays from outside meet a solid; inf where they do not before `far`."""
    away = torch.zeros(len(origins), dtype=origins.dtype)
    found = torch.full_like(away, torch.inf)
    rows = torch.arange(len(origins))
    for _ in range(60):
        distance = sdf(origins[rows] + away[rows, None] * directions[rows])
        met = distance < OVERSTEP * radius / 4
        found[rows[met]] = away[rows[met]]
        away[rows] += distance.clamp_min(OVERSTEP * radius)
        rows = rows[~met & (away[rows] < far)]
        if not len(rows):
            break
    return found


def display(linear: Float[Tensor, "*s 3"]) -> Float[Tensor, "*s 3"]:
    """Display colors of linear light, clipped at 1 as in a photo."""
    return torch.from_numpy(srgb_of_linear(linear.clamp(0, 1).double().numpy())).to(linear)


def captured(
    lit: LitSolid, finish: Finish, count: int, surroundings: int, generator: torch.Generator
) -> tuple[Gaussians, Bool[Tensor, " n"]]:
    """Gaussians of the solid with a matte finish and of its surroundings, as a capture has them:
    clipped; and which of them are the solid's."""
    state = generator.get_state()
    points = surface_points(lit.solid, count, generator)  # discs lie a little under them
    discs = surface_gaussians(lit.solid, count, generator.set_state(state))
    normals = torch.nn.functional.normalize(gradient(lit.solid.sdf, points), dim=-1)
    color = display(lit.outgoing(finish, points, normals, normals, 192))
    discs = Gaussians(
        discs.means, discs.quats, discs.log_scales, discs.logit_opacities,
        color_to_sh(color)[:, None].float(),
    )  # fmt: skip
    around = torch.from_numpy(even_directions(surroundings))
    spread = 0.75 * lit.radius * sqrt(4 * pi / surroundings)
    dome = Gaussians(
        (lit.radius * around).float(),
        torch.tensor((1.0, 0, 0, 0)).repeat(surroundings, 1),
        torch.full((surroundings, 3), spread).log(),
        torch.full((surroundings,), 5.0),
        color_to_sh(display(lit.light(around)))[:, None].float(),
    )
    own = torch.zeros(count + surroundings, dtype=torch.bool)
    own[:count] = True
    return concatenate(discs, dome), own


def garden(directions: Float[Tensor, "*m 3"]) -> Float[Tensor, "*m 3"]:
    """A meadow under a blue sky with a low sun, a wall and a dark wood, all soft; z is up."""
    x, y, z = directions.unbind(-1)
    sky = _mixed(directions, (0.95, 0.95, 0.9), (0.25, 0.42, 0.8), (z * 1.5).clamp(0, 1).sqrt())
    patches = 0.5 + 0.25 * (7 * x + 2 * z).sin() + 0.25 * (9 * y - x).sin()
    ground = _mixed(directions, (0.10, 0.13, 0.04), (0.34, 0.27, 0.16), patches)
    light = _between(ground, sky, (z / 0.06).clamp(-1, 1) / 2 + 0.5)
    wood = torch.sigmoid((0.45 + 0.08 * (8 * x).sin() - z) / 0.04) * torch.sigmoid(
        (y - 0.35) / 0.05
    )
    light = _between(
        light, directions.new_tensor((0.03, 0.05, 0.025)).expand_as(light), wood * (z > -0.02)
    )
    wall = torch.sigmoid((-0.75 - x) / 0.03) * torch.sigmoid((0.4 - z.abs()) / 0.03)
    light = _between(light, directions.new_tensor((0.62, 0.32, 0.2)).expand_as(light), wall)
    sun = torch.nn.functional.normalize(directions.new_tensor((0.6, -0.5, 0.75)), dim=0)
    return light + 9 * torch.sigmoid(((directions @ sun) - 0.97) / 0.004)[..., None]


def plain_base(color: Triple) -> Callable[[Tensor], Tensor]:
    """A base color, given for a display, that is the same everywhere."""
    linear = torch.from_numpy(linear_of_srgb(torch.tensor(color, dtype=torch.float64).numpy()))
    return lambda points: linear.to(points).expand(len(points), 3)


def _between(first: Tensor, second: Tensor, share: Tensor) -> Tensor:
    return torch.lerp(first, second, share[..., None].to(first))


def _mixed(like: Tensor, first: Triple, second: Triple, share: Tensor) -> Tensor:
    start, end = (like.new_tensor(each).expand_as(like) for each in (first, second))
    return _between(start, end, share)


def _frames(normals: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3 3"]:
    """Columns: two unit vectors across each normal, and the normal."""
    axis = torch.nn.functional.one_hot(normals.abs().argmin(-1), 3).to(normals)
    across = torch.nn.functional.normalize(torch.linalg.cross(normals, axis), dim=-1)
    return torch.stack((across, torch.linalg.cross(normals, across), normals), -1)


def _even_square(like: Float[Tensor, "m 3"], samples: int) -> tuple[Tensor, Tensor]:
    """A rank-1 lattice, shifted anew for each row: numbers in [0, 1) for the angle from an axis and
    the one around it. One lattice for all rows would meet a small sun everywhere or nowhere."""
    index = torch.arange(samples, dtype=like.dtype)
    row = torch.arange(len(like), dtype=like.dtype)[:, None]
    height = (index + (row * 0.7548776662466927) % 1) / samples
    return height, (index * 0.6180339887498949 + row * 0.5698402909980532) % 1


def _turned(
    normals: Float[Tensor, "m 3"], cosine: Float[Tensor, "m s"], turn: Float[Tensor, "m s"]
) -> Float[Tensor, "m s 3"]:
    """Directions at angles from each normal, and around it in turns."""
    ring, angle = (1 - cosine.square()).clamp_min(0).sqrt(), 2 * pi * turn
    local = torch.stack((ring * angle.cos(), ring * angle.sin(), cosine), -1)
    return torch.einsum("mij,msj->msi", _frames(normals), local)


def _cosine(normals: Float[Tensor, "m 3"], samples: int) -> Float[Tensor, "m s 3"]:
    """Directions around normals, as dense as the cosine to them."""
    height, turn = _even_square(normals, samples)
    return _turned(normals, (1 - height).sqrt(), turn)


def _microfacets(
    normals: Float[Tensor, "m 3"], roughness: float, samples: int
) -> Float[Tensor, "m s 3"]:
    """Normals of microfacets, as dense as GGX's distribution times the cosine."""
    height, turn = _even_square(normals, samples)
    alpha = max(roughness, 1e-3) ** 2
    return _turned(normals, ((1 - height) / (1 + (alpha**2 - 1) * height)).sqrt(), turn)


def _smith(cosine: Float[Tensor, "m s 1"], roughness: float) -> Float[Tensor, "m s 1"]:
    """Smith's shadowing of GGX in one direction."""
    alpha = max(roughness, 1e-3) ** 2
    cosine = cosine.clamp(1e-3, 1)
    return 2 * cosine / (cosine + (alpha**2 + (1 - alpha**2) * cosine.square()).sqrt())
