"""A large scene made of a real one: copies side by side on its ground, each turned otherwise."""

from __future__ import annotations

from math import ceil

import torch

from gsedit.scene.framing import bounds, guess_up
from gsedit.toolkit.transform import transform
from rasterizer.scene import Gaussians, concatenate

APART = 4.0
"""Distance of neighbors, in radii of the scene's bulk. A copy leaves out what is farther from its
center than half of it: the far splats of a capture would veil the neighbors."""


def side_by_side(scene: Gaussians, copies: int) -> Gaussians:
    """The scene, whose rows come first, and copies of its middle on a square grid of its ground.

    Each copy is turned by another angle about the upward direction. Raises UsageError for an empty
    scene, ValueError for fewer than 1 copy.
    """
    if copies < 1:
        raise ValueError(f"{copies} copies: give 1 or more")
    ball, up = bounds(scene), guess_up(scene)
    aside = torch.linalg.svd(up[None]).Vh[1:] * APART * ball.radius
    distances = (scene.means.double() - torch.tensor(ball.center).double()).norm(dim=1)
    middle = scene[distances < APART / 2 * ball.radius]
    parts, columns = [scene], ceil(copies**0.5)
    for number in range(1, copies):
        row, column = divmod(number, columns)
        parts.append(
            transform(
                middle,
                pivot=ball.center,
                rotate_axis=(*up.tolist(), 360 * number / copies),
                translate=(row * aside[0] + column * aside[1]).tolist(),
            )
        )
    return concatenate(*parts)
