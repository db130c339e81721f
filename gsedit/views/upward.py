"""Which way is up, from what good views see: the ground below them, the horizon before them."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from rasterizer.camera import Camera

NARROW = 0.96
"""Cosine (16 degrees) within which a surface's normal counts for a direction."""
GROUND = 0.06
"""Least share of what is seen that must face up; a scene without ground has no clear direction."""


def normals_from_depth(camera: Camera, depth: Float[Tensor, "h w"]) -> Float[Tensor, "n 3"]:
    """Unit normals of the smooth parts of a depth map, in the world, towards the camera."""
    points = camera.unproject(camera.pixel_centres(), depth.double())
    along = points[:-1, 1:] - points[:-1, :-1]
    down = points[1:, :-1] - points[:-1, :-1]
    near = depth[:-1, :-1].double()
    step = 0.1 * near  # a larger one is a silhouette
    smooth = (near > 0) & (depth[1:, :-1] > 0) & (depth[:-1, 1:] > 0)
    smooth &= (along.norm(dim=-1) < step) & (down.norm(dim=-1) < step)
    normals = torch.linalg.cross(down, along)[smooth]  # x right, y down: this faces the camera
    return torch.nn.functional.normalize(normals, dim=-1)


def find_up(
    directions: Float[Tensor, "d 3"],
    normals: Float[Tensor, "n 3"],
    forwards: Float[Tensor, "v 3"],
) -> Float[Tensor, "3"] | None:
    """The upward unit vector, float64; None where nothing says.

    Of `directions`, the one that most of the surfaces in view face, while the views look across it:
    a person holds a camera level, so that a wall, which one view faces, is one that others look
    along. Twice the mean square of forward . up is 1 for a wall's normal in a room.
    """
    if not len(normals):
        return None
    facing = ((normals @ directions.T) > NARROW).double().mean(0)
    across = (1 - 2 * (forwards @ directions.T).square().mean(0)).clamp_min(0)
    score = facing * across
    best = int(score.argmax())
    if float(facing[best]) < GROUND or float(score[best]) <= 0:
        return None
    near = normals[(normals @ directions[best]) > NARROW]
    return torch.nn.functional.normalize(near.mean(0), dim=0)
