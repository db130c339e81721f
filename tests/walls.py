"""Views of a wall with a ball before it: depth is a formula, so true matches are known."""

import torch

from rasterizer import look_at

CELL = 8
UP = torch.tensor([0.0, -1.0, 0.0])
FRONTAL = (torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), 4.0)
"""A wall across the view: planes are (normal, offset), points with normal @ x = offset."""
SLANTED = (torch.tensor([0.6, 0.2, 1.0], dtype=torch.float64), 4.0)
"""A wall turned by 32 degrees: depth, scale and rounding differ all over the picture."""


def camera(x, y=0.0, z=0.0, size=128):
    origin = torch.tensor([x, y, z])
    return look_at(origin, torch.tensor([0.0, 0.0, 4.0]), UP, 40.0, size, size)


def rays(view, xy):
    """World direction of depth 1 through each position, and the origin."""
    return view.unproject(xy, torch.ones_like(xy[..., 0])) - view.center, view.center


def plane_depth(view, plane, xy=None):
    normal, offset = plane
    direction, origin = rays(view, view.pixel_centers() if xy is None else xy)
    return (offset - origin @ normal) / (direction @ normal)


def sphere_depth(view, center, radius, xy=None):
    """Inf where the ray misses."""
    direction, origin = rays(view, view.pixel_centers() if xy is None else xy)
    offset = origin - center
    a, b = direction.square().sum(-1), direction @ offset
    root = b.square() - a * (offset @ offset - radius**2)
    return torch.where(root >= 0, (-b - root.clamp_min(0).sqrt()) / a, torch.inf)


BALL = (torch.tensor([0.1, 0.05, 2.6], dtype=torch.float64), 0.4)
"""In front of the wall: it hides different parts of it from each view."""


def occluded_depth(view, xy=None):
    return torch.minimum(plane_depth(view, SLANTED, xy), sphere_depth(view, *BALL, xy))


def seen(view, depth=None):
    depth = plane_depth(view, SLANTED) if depth is None else depth
    return view, depth, torch.ones_like(depth)


def centers(view, index):
    columns = view.width // CELL
    return torch.stack((index % columns, index // columns), -1).double() * CELL + CELL / 2


def true_error(a, b, pairs, depth_of):
    """Distance in cells, along either axis, from the matched cell's center to the true position."""
    xy = centers(a, pairs.a)
    true, _ = b.project(a.unproject(xy, depth_of(a, xy)))
    return (true - centers(b, pairs.b)).abs().amax(-1) / CELL


def clusters(labels):
    """The partition that labels describe, whatever the clusters are called."""
    groups = {}
    for index, name in enumerate(labels.flatten().tolist()):
        if name >= 0:
            groups.setdefault(name, set()).add(index)
    return {frozenset(g) for g in groups.values()}


FOUR = [camera(x, y) for x, y in ((-0.7, 0.1), (-0.2, -0.25), (0.3, 0.2), (0.9, -0.1))]


def stacked(cameras, depth_of=occluded_depth):
    depths = torch.stack([depth_of(c) for c in cameras])
    return cameras, depths, torch.ones_like(depths)
