"""Light that surfaces of a material send to a camera, in the light of their surroundings.

Diffuse: the light that arrives from all directions, with the subject's own shadow. Reflected: the
surroundings as the roughness sees them in the mirror direction, times the environment's BRDF of the
split sum. Linear light throughout; `n` Gaussians, `p` pairs of a
Gaussian and a direction to a camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.change.materials.patterns import Ground, share_of
from gsedit.change.materials.table import Material
from gsedit.scene.color_space import linear_of_srgb, srgb_of_hex
from gsedit.scene.quaternions import even_directions
from gsedit.views.surroundings import Surroundings, look_up, prefiltered, reflected, softened

RAYS = 96
"""Directions, even over the sphere, in which light that arrives is looked up."""
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
COAT_ROUGHNESS = 0.08
COAT_SPECULAR = 0.06
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
    """Surface of a subject, one row a Gaussian: where, how turned, how carved, what it sees."""

    points: Float[Tensor, "n 3"]
    normals: Float[Tensor, "n 3"]
    detail: Float[Tensor, " n"]
    """Factor on the light for what is carved finer than the normals show."""
    open: Float[Tensor, "n d"]
    """Share of the light from each of `ray_directions` that comes past the subject itself."""

    def __getitem__(self, rows: slice | Tensor) -> Skin:
        return Skin(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def __len__(self) -> int:
        return len(self.points)

    @property
    def cosines(self) -> Float[Tensor, "n d"]:
        """Cosines between the normals and the directions of light."""
        return self.normals @ ray_directions().to(self.normals).T

    @property
    def share(self) -> Float[Tensor, "n d"]:
        """Weight of each direction in what a surface receives in front; 0 where it is hidden."""
        facing = self.cosines.clamp_min(0)
        return facing * self.open / facing.sum(1, keepdim=True).clamp_min(1e-6)

    def open_to(self, ways: Float[Tensor, "n 3"]) -> Float[Tensor, "n 1"]:
        """Share of the light from one direction each, between those that are known."""
        near = torch.exp(BETWEEN * (ways @ ray_directions().to(ways).T - 1))
        return (near * self.open).sum(1, keepdim=True) / near.sum(1, keepdim=True)


@dataclass(frozen=True, eq=False)
class Reflectance:
    """Parameters of a material at each Gaussian; colors in linear light."""

    color: Float[Tensor, "n 3"]
    metalness: Float[Tensor, " n"]
    roughness: Float[Tensor, " n"]
    coat: Float[Tensor, " n"]
    glow: Float[Tensor, " n"]

    def __getitem__(self, rows: slice | Tensor) -> Reflectance:
        return Reflectance(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def lighting(surroundings: Surroundings, matte: bool = False) -> Lighting:
    """The surroundings, made ready; without `maps` for what is matte."""
    plain = softened(surroundings, ARRIVING)
    maps = plain[None][:0] if matte else prefiltered(surroundings)
    return Lighting(surroundings, maps, plain)


def reflectance(material: Material, ground: Ground) -> Reflectance:
    """The parameters of a material at each point of the ground, with its patterns."""
    n = len(ground.points)
    like = ground.points

    def even(value: float) -> Tensor:
        return like.new_full((n,), value)

    found = Reflectance(
        _linear(material.color).to(like).expand(n, 3),
        even(material.metalness),
        even(material.roughness),
        even(material.coat),
        even(material.glow),
    )
    for layer in material.layers:
        share = share_of(layer, ground)
        bare = 1 - share if layer.roughness > material.roughness else torch.ones_like(share)
        found = Reflectance(
            torch.lerp(found.color, _linear(layer.color).to(like).expand(n, 3), share[:, None]),
            torch.lerp(found.metalness, even(layer.metalness), share),
            torch.lerp(found.roughness, even(layer.roughness), share),
            found.coat * bare,
            torch.lerp(found.glow, even(layer.glow), share),
        )
    return found


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


def outgoing(
    light: Lighting,
    material: Material,
    surface: Reflectance,
    skin: Skin,
    diffuse: Float[Tensor, "p 3"],
    own: Float[Tensor, "p 3"],
    views: Float[Tensor, "p 3"],
) -> Float[Tensor, "p 3"]:
    """Linear light that points of a skin send in unit directions `views`, to cameras.

    `diffuse` is what its body sends everywhere (see `body`), `own` what the subject sends where it
    hides its surroundings.
    """
    cosine = (skin.normals * views).sum(-1)
    # views from behind see the rim: the normal is turned just so far that it is in sight
    facing = torch.nn.functional.normalize(
        skin.normals + (GRAZING - cosine).clamp_min(0)[:, None] * views, dim=-1
    )
    cosine = (facing * views).sum(-1).clamp(GRAZING, 1)
    mirror = 2 * cosine[:, None] * facing - views
    seen = skin.open_to(mirror)
    head_on = torch.lerp(
        torch.full_like(surface.color, material.specular),
        surface.color,
        surface.metalness[:, None],
    )
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
        sent = sent * (1 - share) + gloss * share
    return sent * skin.detail[:, None] + surface.glow[:, None] * surface.color


def everywhere(
    material: Material,
    surface: Reflectance,
    skin: Skin,
    diffuse: Float[Tensor, "n 3"],
    front: Float[Tensor, "n 3"],
) -> Float[Tensor, "n 3"]:
    """Linear light that a matte skin sends to cameras, about alike in all directions.

    It reflects the light that arrives in `front`, as seen from USUAL_COSINE.
    """
    head_on = torch.full_like(surface.color, material.specular)
    cosine = torch.full_like(surface.roughness, USUAL_COSINE)
    gloss = front * environment_brdf(head_on, surface.roughness, cosine)
    return (diffuse + gloss) * skin.detail[:, None] + surface.glow[:, None] * surface.color


def body(
    material: Material, surface: Reflectance, sides: Float[Tensor, "n 2 3"]
) -> Float[Tensor, "n 3"]:
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
    part for GGX and Schlick."""
    x, y = 1 - roughness, -0.0275 * roughness + 0.0425
    z, w = -0.572 * roughness + 1.04, 0.022 * roughness - 0.04
    a = torch.minimum(x * x, torch.exp2(-9.28 * cosine)) * x + y
    scale, offset = -1.04 * a + z, 1.04 * a + w
    return head_on * scale[..., None] + offset[..., None]


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


def _linear(color: str) -> Float[Tensor, "3"]:
    return torch.from_numpy(linear_of_srgb(srgb_of_hex(color)))
