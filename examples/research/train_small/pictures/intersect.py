"""Intersections of rays and solids in closed form: one matrix product casts all rays at all
quadrics."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from research.train_small.pictures.camera import Pinhole
from research.train_small.pictures.solids import BALL, BOX, DRUM, Solids


def first_solid(
    solids: Solids, camera: Pinhole, xy: Float[Tensor, "2 m"]
) -> tuple[Float[Tensor, " m"], Int[Tensor, " m"]]:
    """Depth and number of the solid that each ray meets first; inf and 0 where it meets none.

    `xy` is where the rays go at unit depth, in the camera's axes; depths are in world units.
    """
    directions = camera.directions(xy)
    depth = torch.full_like(xy[0], torch.inf)
    number = torch.zeros_like(xy[0], dtype=torch.long)
    for kind in (BALL, BOX, DRUM):
        rows = (solids.kind == kind).nonzero().squeeze(-1)
        if not len(rows):
            continue
        some = solids.rows(rows)
        start = some.local(camera.origin[None])
        if kind == BOX:
            depths = box_depth(some.to_local, start, directions)
        else:
            depths = quadric_depth(some, camera, xy)
        if kind == DRUM:
            depths = _capped(depths, some, start, directions)
        near, which = depths.min(0)
        number = torch.where(near < depth, rows[which], number)
        depth = torch.where(near < depth, near, depth)
    return depth, number


def quadric_depth(
    solids: Solids, camera: Pinhole, xy: Float[Tensor, "2 m"]
) -> Float[Tensor, "k m"]:
    """Depths at which rays enter balls and the sides of drums; inf where they do not.

    With a direction d linear in (x, y, 1), |d|^2 and the discriminant are quadratic forms: their
    coefficients, in float64, times the monomials of all rays.
    """
    x, y = xy
    monomials = torch.stack((x * x, x * y, y * y, x, y, torch.ones_like(x)))
    to_local = solids.to_local.double()
    offset = camera.origin.double() - solids.center.double()
    start = (to_local @ offset[:, :, None]).squeeze(-1)
    along = to_local @ camera.axes.double().T  # columns: what x, y and 1 contribute
    flat = (solids.kind == BALL).double()[:, None]
    slope = ((solids.taper - 1) / 2).double()[:, None]
    middle = 1 + slope
    # a point p: p_x^2 + p_y^2 + flat p_z^2 - (1 - flat) (middle + slope p_z)^2 = flat
    one = torch.ones_like(flat)
    metric = torch.cat((one, one, flat - (1 - flat) * slope**2), -1)
    a_form = along.mT @ (metric[..., None] * along)
    b_row = ((metric * start)[:, None] @ along).squeeze(1)
    b_row = b_row - (1 - flat) * middle * slope * along[:, 2]
    c = (metric * start * start).sum(-1, keepdim=True) - flat
    c = c - (1 - flat) * (middle**2 + 2 * middle * slope * start[:, 2:])
    discriminant = b_row[:, :, None] * b_row[:, None] - c[..., None] * a_form
    a = _coefficients(a_form) @ monomials
    b = b_row.float() @ monomials[3:]
    inner = _coefficients(discriminant) @ monomials
    depth = (-b - inner.clamp_min(0).sqrt()) / a
    return depth.masked_fill((inner <= 0) | (depth <= 0), torch.inf)


def _coefficients(form: Float[Tensor, "k 3 3"]) -> Float[Tensor, "k 6"]:
    """Coefficients of x^2, x y, y^2, x, y, 1 in a symmetric form of (x, y, 1)."""
    (xx, xy, x), (_, yy, y), (_, _, one) = (row.unbind(-1) for row in form.float().unbind(1))
    return torch.stack((xx, 2 * xy, yy, 2 * x, 2 * y, one), -1)


def box_depth(
    to_local: Float[Tensor, "k 3 3"],
    start: Float[Tensor, "k 3 #m"],
    directions: Float[Tensor, "3 m"],
) -> Float[Tensor, "k m"]:
    """Depths at which rays enter boxes; inf where they do not. `start` is in the boxes' own
    coordinates, `directions` in the world's."""
    along = to_local @ directions
    along = torch.where(along.abs() < 1e-9, 1e-9, along).reciprocal()
    middle, reach = -start * along, along.abs()
    near, far = (middle - reach).amax(1), (middle + reach).amin(1)
    return near.masked_fill((near >= far) | (near <= 0), torch.inf)


def _capped(
    side: Float[Tensor, "k m"],
    drums: Solids,
    start: Float[Tensor, "k 3 1"],
    directions: Float[Tensor, "3 m"],
) -> Float[Tensor, "k m"]:
    """Depths on the sides of drums cut off at their ends, with the end that faces the camera."""
    along = drums.to_local @ directions
    height = start[:, 2] + side.nan_to_num(posinf=0) * along[:, 2]
    side = side.masked_fill(height.abs() > 1, torch.inf)
    end = start[:, 2].sign()
    lid = (end - start[:, 2]) / along[:, 2]
    across = (start[:, :2] + lid[:, None] * along[:, :2]).square().sum(1)
    radius = torch.where(end > 0, drums.taper[:, None], 1.0)
    missed = (across > radius**2) | (lid <= 0) | (start[:, 2].abs() < 1)
    return torch.minimum(side, lid.masked_fill(missed, torch.inf))
