"""Light that surfaces of a material send to a camera, in the light of their surroundings; and the
patterns on them: how much of a layer is at each point, by noise in space that has no seams.

Diffuse: the light that arrives from all directions, with the subject's own shadow. Reflected: the
surroundings as the roughness sees them in the mirror direction, times the environment's BRDF of the
split sum. Linear light throughout; `n` Gaussians, `p` pairs of one and a direction to a camera.
Patterns are in radii of the subject, around its middle, +z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.change.materials.material import Layer, Material
from gsedit.scene.color_space import linear_of_srgb, srgb_of_hex
from gsedit.scene.quaternions import even_directions
from gsedit.views.noise import noise
from gsedit.views.surroundings import (
    FAINT,
    ROWS,
    Surroundings,
    cell_directions,
    cell_of,
    look_up,
    prefiltered,
    reflected,
    softened,
)

Vectors = Float[Tensor, "n 3"]

WAVES = 40
"""Plane waves of a noise on a subject: of 14, specks lean one way and patches are checkered."""
OCTAVES = 4
LEAST_HOLLOW = 0.45
"""How hollow crevices are at least: what is nearly flat has none, whatever their share."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Surface that patterns are on."""

    points: Vectors
    """Positions in radii of the subject, around its middle, +z up."""
    normals: Vectors
    """Outward unit normals, in the same axes."""
    hollow: Float[Tensor, " n"]
    """How much the surface is hollow or carved there, in [0, 1]."""


def share_of(layer: Layer, ground: Ground) -> Float[Tensor, " n"]:
    """How much of a layer is at each point, in [0, 1]; about its share over the surface."""
    field, width = _FIELDS[layer.pattern](ground, max(layer.scale, 1e-3))
    if not len(field):
        return field
    some = field[:: 1 + len(field) // 100_000]  # the quantile is the same
    edge = torch.quantile(some, 1 - min(max(layer.share, 0.0), 1.0))
    least = LEAST_HOLLOW if layer.pattern == "crevices" else -torch.inf
    return torch.sigmoid((field - edge.clamp_min(least)) / width)


def coverage(layers: tuple[Layer, ...], ground: Ground) -> Float[Tensor, " n"]:
    """How much any of the layers is at each point, in [0, 1]; 1 without layers."""
    bare = torch.full_like(ground.hollow, float(bool(layers)))
    for layer in layers:
        bare = bare * (1 - share_of(layer, ground))
    return 1 - bare


def grain(points: Vectors, seed: int = 0) -> Float[Tensor, " n"]:
    """Noise of materials, with seeds apart from those of weather."""
    return noise(points, 1000 + seed, WAVES)


def turbulence(points: Vectors, seed: int = 0, octaves: int = OCTAVES) -> Float[Tensor, " n"]:
    """Noise of several sizes, each half as large and as strong as the one before."""
    return sum(
        (grain(points * 2**i, seed + i) / 2**i for i in range(octaves)),
        start=torch.zeros_like(points[:, 0]),
    )


def _warped(points: Vectors, strength: float, seed: int = 50) -> Vectors:
    shifts = [turbulence(points, seed + 10 * axis, 3) for axis in range(3)]
    return points + strength * torch.stack(shifts, -1)


def _veins(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Thin lines where a bent noise is 0, thicker and fainter in turn."""
    bent = _warped(ground.points / scale, 0.45)
    lines = -grain(bent).abs() + 0.25 * grain(bent * 0.5, 7)
    return torch.maximum(lines, -1.6 * grain(bent * 1.9, 3).abs() - 0.15), 0.06


def _rings(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Year rings around an axis that leans and wanders, with fibers along it."""
    x, y, z = ground.points.unbind(-1)
    wander = 0.6 * scale * grain(ground.points * 1.2)
    away = ((x + 0.35 + 0.15 * z).square() + (y - 0.2 * z).square()).sqrt() + wander
    fiber = grain(ground.points * ground.points.new_tensor((40.0, 40.0, 3.0)), 4)
    return (2 * pi * away / scale).sin() + 0.2 * fiber, 0.22


def _grain(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Streaks along z, as in fibers and brushed metal."""
    stretched = ground.points / scale * ground.points.new_tensor((1.0, 1.0, 0.08))
    return turbulence(stretched, 2, 2), 0.5


def _strata(ground: Ground, scale: float) -> tuple[Tensor, float]:
    bent = ground.points[:, 2] / scale + 0.35 * turbulence(ground.points / scale / 4, 20, 3)
    along = torch.stack((bent * 0 + 0.1, bent * 0 + 0.2, bent), -1)
    return turbulence(along, 23, 3), 0.35


def _weave(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Two threads, over and under; on each side of the subject along the axes it faces least."""
    u, v = _flat(ground)
    over = (pi * u / scale).sin() * (pi * v / scale).sin()
    return over + 0.1 * grain(ground.points / scale * 3, 6), 0.2


def _bricks(ground: Ground, scale: float) -> tuple[Tensor, float]:
    """Joints between rows of bricks, twice as long as high, each row half a brick on."""
    u, v = _flat(ground)
    row = (v / scale).floor()
    across = ((v / scale) % 1 - 0.5).abs()
    along = ((u / (2 * scale) + 0.5 * (row % 2)) % 1 - 0.5).abs()
    return torch.maximum(across, 0.5 - 2 * (0.5 - along)), 0.02


def _flat(ground: Ground) -> tuple[Tensor, Tensor]:
    """Two coordinates along the surface: height, and the one across it that the normal faces
    least."""
    x, y, z = ground.points.unbind(-1)
    side = ground.normals.abs()
    lies = side[:, 2] > side[:, :2].amax(-1)
    u = torch.where(side[:, 0] > side[:, 1], y, x)
    return u, torch.where(lies, torch.where(side[:, 0] > side[:, 1], x, y), z)


_FIELDS = {
    "veins": _veins,
    "rings": _rings,
    "grain": _grain,
    "specks": lambda ground, scale: (
        grain(ground.points / scale) + 0.6 * grain(ground.points * (2.3 / scale), 5),
        0.15,
    ),
    "patches": lambda ground, scale: (
        turbulence(_warped(ground.points / scale, 0.3), 11) + 0.5 * ground.hollow,
        0.12,
    ),
    "strata": _strata,
    "weave": _weave,
    "bricks": _bricks,
    "crevices": lambda ground, scale: (
        ground.hollow + 0.12 * turbulence(ground.points / scale, 31),
        0.1,
    ),
    "up": lambda ground, scale: (
        ground.normals[:, 2] + 0.35 * turbulence(ground.points / scale, 37),
        0.12,
    ),
}


RAYS = 96
"""Directions, even over the sphere, in which light that arrives is looked up, and that colors are
fitted to."""
BETWEEN = 40.0
"""Sharpness of a direction's weight in what is seen between them: half at 11 degrees."""
ARRIVING = 0.45
"""Roughness at which light is softened as much as these directions are apart."""
GRAZING = 0.08
"""Least cosine between a normal and a view: beyond lies the back."""
USUAL_COSINE = 0.65
"""Mean cosine between the normals of a round thing and a view, weighted by what is seen."""
FARTHEST = 1e3
"""Distance of a sky that nothing is known of, against the farthest thing that is seen."""
FOLLOWS = 0.35
"""Share of the way that mirrors turn with the eye: SH of degree 3 blur light by 60 degrees of view,
which are so many fewer of the surroundings, and highlights stay sharp."""
OPAQUE, LAYERS = 0.993, 3.0
"""Largest opacity of a disc, and how many lie on each other where one looks."""
COAT_ROUGHNESS = 0.08
COAT_SPECULAR = 0.1
"""Reflectance of a coat head on: more than glass has, whose mirrored lamps are small and clip."""
THROUGH_BEND = 0.7
"""Share of the view direction that is left in light that has come through a solid: the rest is
turned towards the inside."""
DEEP = 0.6
"""How much deeper in color light is that has gone through a body, as a power above 1."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """Light on a subject, made ready for many look-ups."""

    surroundings: Surroundings
    maps: Float[Tensor, "r h w 3"]
    """The surroundings, prefiltered for each of ROUGHNESSES."""
    plain: Float[Tensor, "h w 3"]
    """The surroundings, softened, as they light what is matte."""


def ray_directions() -> Float[Tensor, "d 3"]:
    """The directions in which light is looked up, float32."""
    return torch.from_numpy(even_directions(RAYS)).float()


@dataclass(frozen=True, eq=False)
class Skin:
    """Surface of a subject, one row a Gaussian: where, how turned, what it sees."""

    points: Vectors
    normals: Vectors
    past: Float[Tensor, "k d"]
    """Share of the light from each of `ray_directions` that comes past the subject itself, at some
    of the points."""
    at: Int[Tensor, " n"]
    """Row of `past` of each."""

    def __getitem__(self, rows: slice | Tensor) -> Skin:
        points, normals, at = (each[rows] for each in (self.points, self.normals, self.at))
        return Skin(points, normals, self.past, at)  # of pairs, the largest part is not taken

    def __len__(self) -> int:
        return len(self.points)

    @property
    def open(self) -> Float[Tensor, "n d"]:
        """Share of the light from each direction that comes to each of them."""
        return self.past[self.at]

    @property
    def cosines(self) -> Float[Tensor, "n d"]:
        """Cosines between the normals and the directions of light."""
        return self.normals @ ray_directions().to(self.normals).T

    @property
    def share(self) -> Float[Tensor, "n d"]:
        """Weight of each direction in what a surface receives in front; 0 where it is hidden."""
        facing = self.cosines.clamp_min(0)
        return facing * self.open / facing.sum(1, keepdim=True).clamp_min(1e-6)

    def open_to(self, ways: Vectors) -> Float[Tensor, "n 1"]:
        """Share of the light from one direction each, between those that are known."""
        rays, weights = _rays_near()
        cell = cell_of(ways, ROWS)
        return (self.past[self.at[:, None], rays[cell]] * weights[cell]).sum(1, keepdim=True)


@lru_cache(1)
def _rays_near() -> tuple[Int[Tensor, "c 3"], Float[Tensor, "c 3"]]:
    """Rows of the directions of light that are nearest to each cell of a map, and their weights."""
    cosines = cell_directions(ROWS).reshape(-1, 3) @ ray_directions().T
    nearest, rays = cosines.topk(3)
    return rays, torch.softmax(BETWEEN * nearest, -1)


@dataclass(frozen=True, eq=False)
class Reflectance:
    """Parameters of a material at each Gaussian; colors in linear light."""

    color: Vectors
    metalness: Float[Tensor, " n"]
    roughness: Float[Tensor, " n"]
    coat: Float[Tensor, " n"]
    glow: Float[Tensor, " n"]

    def __getitem__(self, rows: slice | Tensor) -> Reflectance:
        return Reflectance(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def lighting(surroundings: Surroundings, mirrored: Surroundings | None = None) -> Lighting:
    """The surroundings, made ready, and as they are mirrored; without `maps` for what is matte."""
    plain = softened(surroundings, ARRIVING)
    maps = plain[None][:0] if mirrored is None else prefiltered(mirrored)
    return Lighting(mirrored or surroundings, maps, plain)


def reflectance(material: Material, ground: Ground) -> Reflectance:
    """The parameters of a material at each point of the ground, with its patterns."""
    points = ground.points

    def even(of: Material | Layer) -> Float[Tensor, "n 6"]:
        numbers = torch.tensor((of.metalness, of.roughness, of.glow))
        color = torch.from_numpy(linear_of_srgb(srgb_of_hex(of.color or "#808080")))
        return torch.cat((color, numbers)).to(points).expand(len(points), 6)

    found, coat = even(material), points.new_full((len(points),), material.coat)
    for layer in material.layers:
        share = share_of(layer, ground)
        found = torch.lerp(found, even(layer), share[:, None])
        coat = coat * (1 - share) if layer.roughness > material.roughness else coat
    metalness, roughness, glow = found[:, 3:].unbind(1)
    return Reflectance(found[:, :3], metalness, roughness, coat, glow)


def arriving(light: Lighting, skin: Skin) -> Float[Tensor, "n 2 3"]:
    """Mean light, weighted by the cosine, that arrives in front of and behind each surface; where
    the subject hides its surroundings, half of their mean."""
    directions = ray_directions().to(skin.points)
    sent = look_up(light.plain, mirror_of(light, skin.points[:, None], directions))
    sent = torch.lerp(0.5 * sent.mean((0, 1)).expand_as(sent), sent, skin.open[..., None])
    sides = []
    for side in (skin.cosines, -skin.cosines):
        weight = side.clamp_min(0)
        total = weight.sum(1, keepdim=True).clamp_min(1e-6)
        sides.append(torch.einsum("nd,ndc->nc", weight, sent) / total)
    return torch.stack(sides, 1)


def opacity_of(material: Material) -> float:
    """Opacity of one disc in a material, of which about LAYERS lie on each other."""
    return min(OPAQUE, 1 - material.transmission ** (1 / LAYERS))


def outgoing(
    light: Lighting,
    material: Material,
    surface: Reflectance,
    skin: Skin,
    diffuse: Float[Tensor, "p 3"],
    own: Float[Tensor, "p 3"],
    views: Float[Tensor, "p 3"],
    clear: bool = False,
) -> Float[Tensor, "p 3"]:
    """Linear light that points of a skin send in unit directions `views`, to cameras.

    `diffuse` is what its body sends everywhere (see `body`), `own` what the subject sends where it
    hides its surroundings. A `clear` skin lets light through: what it mirrors is brighter before
    blending.
    """
    cosine = (skin.normals * views).sum(-1)
    # views from behind see the rim: the normal is turned just so far that it is in sight
    facing = torch.nn.functional.normalize(
        skin.normals + (GRAZING - cosine).clamp_min(0)[:, None] * views, dim=-1
    )
    cosine = (facing * views).sum(-1).clamp(GRAZING, 1)
    aside = cosine[:, None] * facing - views
    mirror = torch.nn.functional.normalize(facing + FOLLOWS * aside, dim=-1)
    seen = skin.open_to(mirror)
    stone = torch.full_like(surface.color, material.specular)
    head_on = torch.lerp(stone, surface.color, surface.metalness[:, None])
    rough = surface.roughness
    bent = mirror_of(light, skin.points, mirror)
    sharp = torch.lerp(own, reflected(light.maps, bent, rough), seen)
    sent = diffuse + sharp * environment_brdf(head_on, rough, cosine)
    if material.transmission:
        through = torch.nn.functional.normalize(
            -THROUGH_BEND * views - (1 - THROUGH_BEND) * facing, dim=-1
        )
        behind = reflected(light.maps, through, rough)
        sent = torch.lerp(sent, behind * surface.color, material.transmission)
    if material.coat:
        smooth = torch.full_like(rough, COAT_ROUGHNESS)
        glaze = torch.full_like(head_on, COAT_SPECULAR)
        share = environment_brdf(glaze, smooth, cosine) * surface.coat[:, None]
        gloss = torch.lerp(own, reflected(light.maps, bent, smooth), seen)
        sent = sent * (1 - share) + gloss * share / (1 - clear * material.transmission)
    return sent + surface.glow[:, None] * surface.color


def everywhere(
    material: Material, surface: Reflectance, diffuse: Vectors, front: Vectors
) -> Vectors:
    """Linear light that a matte skin sends to cameras, about alike in all directions.

    It reflects the light that arrives in `front`, as seen from USUAL_COSINE.
    """
    head_on = torch.full_like(surface.color, material.specular)
    cosine = torch.full_like(surface.roughness, USUAL_COSINE)
    gloss = front * environment_brdf(head_on, surface.roughness, cosine)
    return diffuse + gloss + surface.glow[:, None] * surface.color


def body(material: Material, surface: Reflectance, sides: Float[Tensor, "n 2 3"]) -> Vectors:
    """Light that bodies send alike in all directions: albedo times what arrives, and what has gone
    through, softer and deeper in color."""
    front, back = sides.unbind(1)
    white = 1 - surface.metalness[:, None]
    share = material.translucency
    deep = surface.color ** (1 + DEEP * share)
    through = 0.5 * (front + back)
    return white * ((1 - share) * surface.color * front + share * deep * through)


def environment_brdf(
    head_on: Float[Tensor, "p 3"], roughness: Float[Tensor, " p"], cosine: Float[Tensor, " p"]
) -> Float[Tensor, "p 3"]:
    """Share of the prefiltered light that is reflected: Karis' fit (2014) of the split sum's second
    part for GGX and Schlick. Metals keep their hue but for the last degrees (Hoffman 2019)."""
    x, y = 1 - roughness, -0.0275 * roughness + 0.0425
    z, w = -0.572 * roughness + 1.04, 0.022 * roughness - 0.04
    a = torch.minimum(x * x, torch.exp2(-9.28 * cosine)) * x + y
    scale, offset = -1.04 * a + z, 1.04 * a + w
    hue = head_on / head_on.amax(-1, keepdim=True).clamp_min(FAINT)
    edge = torch.lerp(hue, torch.ones_like(hue), ((1 - cosine) ** 5)[..., None])
    return head_on * scale[..., None] + edge * offset[..., None]


def mirror_of(
    light: Lighting, points: Float[Tensor, "*#p 3"], directions: Float[Tensor, "*#p 3"]
) -> Float[Tensor, "*p 3"]:
    """Directions from the middle of the subject to what rays from its points meet."""
    distance = light.surroundings.distance[..., None]
    known = distance.isfinite()
    if not known.any():
        return directions.expand(torch.broadcast_shapes(points.shape, directions.shape))
    far = torch.where(known, distance, FARTHEST * distance[known].max())
    offset = points - light.surroundings.center
    away = look_up(far, directions)
    along = (offset * directions).sum(-1, keepdim=True)
    rest = (away.square() - offset.square().sum(-1, keepdim=True)).clamp_min(0)
    reach = -along + (along.square() + rest).sqrt()
    return torch.nn.functional.normalize(offset + reach * directions, dim=-1)
