"""The geometry of what rays meet: normals, and coordinates for textures."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from research.train_small.pictures.solids import BALL, BOX, DRUM, Solids
from research.train_small.pictures.vectors import normalized


def solid_normals(
    solids: Solids, points: Float[Tensor, "m 3"], number: Int[Tensor, " m"], crease: float
) -> Float[Tensor, "m 3"]:
    """Unit outward normals at points on the solids of these numbers; balls of a thing flow into
    each other over `crease` world units."""
    to_local, kind = solids.to_local[number], solids.kind[number]
    taper, subject = solids.taper[number], solids.subject[number]
    local = (to_local @ (points - solids.center[number])[:, :, None]).squeeze(-1)
    gradient = torch.where((kind == DRUM)[:, None], _drum_gradient(local, taper), local)
    gradient = torch.where((kind == BOX)[:, None], _box_gradient(local), gradient)
    normals = normalized((to_local.mT @ gradient[:, :, None]).squeeze(-1), dim=-1)
    on_ball = kind == BALL
    if on_ball.any():
        normals[on_ball] = _union_normals(solids, points[on_ball], subject[on_ball], crease)
    return normals


def _drum_gradient(local: Float[Tensor, "m 3"], taper: Float[Tensor, " m"]) -> Float[Tensor, "m 3"]:
    """Outward, in the drums' own coordinates: of a lid near the ends, of the side elsewhere."""
    x, y, z = local.unbind(-1)
    slope = (taper - 1) / 2
    side = torch.stack((x, y, -slope * (1 + slope + slope * z)), -1)
    lid = torch.stack((torch.zeros_like(z), torch.zeros_like(z), z), -1)
    return torch.where((z.abs() > 0.998)[:, None], lid, side)


def _box_gradient(local: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    """Outward, in the boxes' own coordinates; edges are rounded over a small share of the faces."""
    return local * (local.abs() / local.abs().amax(-1, keepdim=True)) ** 30


def _union_normals(
    solids: Solids, points: Float[Tensor, "m 3"], subject: Bool[Tensor, " m"], crease: float
) -> Float[Tensor, "m 3"]:
    """Unit normals of the soft union of all balls, of the subject or of the rest."""
    balls = solids.rows(solids.kind == BALL)
    local = balls.local(points)
    size = local.square().sum(1).sqrt().clamp_min(1e-6)
    gradient = balls.to_local.mT @ (local / size[:, None])
    steep = gradient.square().sum(1).sqrt()
    distance = (size - 1) / steep + 9.0 * (balls.subject[:, None] != subject)
    share = (-distance / (0.35 * crease)).softmax(0)
    return normalized((gradient * (share / steep)[:, None]).sum(0).T, dim=-1)


def turned_to_view(
    normals: Float[Tensor, "m 3"], directions: Float[Tensor, "m 3"]
) -> Float[Tensor, "m 3"]:
    """Normals that look away from the rays made perpendicular to them; not of unit length."""
    facing = (normals * directions).sum(-1, keepdim=True)
    excess = facing * directions / directions.square().sum(-1, keepdim=True)
    return torch.where(facing > 0, normals - excess, normals)


def surface_uv(points: Float[Tensor, "m 3"], normals: Float[Tensor, "m 3"]) -> Float[Tensor, "2 m"]:
    """Texture coordinates in world units: the two axes across the normal's largest component."""
    x, y, z = points.T
    largest = normals.abs().argmax(-1)
    return torch.stack((torch.where(largest == 0, y, x), torch.where(largest == 2, y, z)))
