"""Matches of two views alone, as `correspond` finds them for every two of many."""

from __future__ import annotations

import torch

from gsedit.paper.consistency.correspond import cell_surfaces, mutual
from gsedit.views.depth_maps import DEFAULT_RULES


@torch.no_grad()
def match(camera_a, depth_a, alpha_a, camera_b, depth_b, alpha_b, cell=8, rules=DEFAULT_RULES):
    """Mutual matches between the cells of two views; symmetric in them."""
    views = (camera_a, depth_a, alpha_a), (camera_b, depth_b, alpha_b)
    return mutual(*(cell_surfaces(*each, cell, rules) for each in views), rules)


def correspondence(scene, camera_a, xy, camera_b):
    """Places where camera_b has the surface that camera_a sees at pixels `xy`, and whether it sees
    it; nan where camera_a sees none."""
    depth = scene._depth(camera_a, xy.reshape(-1, 2)).reshape(xy.shape[:-1])
    hit = depth.isfinite()
    points = camera_a.unproject(xy, depth.masked_fill(~hit, torch.nan))
    return camera_b.project(points)[0], hit & scene.visible(points, camera_b)
