"""A plane sweep finds the surfaces of ray-traced photos, and says nothing where it cannot know."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from scipy.spatial import KDTree
from small_scenes import generator, scenes, traced_dataset

from gsedit.bench.synthetic import ring_cameras
from gsedit.capture.fitting.initial import initial_scene, swept_points


@pytest.fixture(scope="module")
def photos():
    """10 views of a globe that fills them, 7.5 degrees apart, and 5,000 points on it."""
    ring = ring_cameras(scenes()[0], 48, 96)[:10]
    cameras = [replace(c, fx=2.2 * c.fx, fy=2.2 * c.fy) for c in ring]
    return traced_dataset(scenes()[0], cameras, points=5000)


def distances(places, photos):
    nearest, rows = KDTree(photos.points.numpy()).query(places.numpy())
    return torch.from_numpy(nearest), torch.from_numpy(rows)


def test_points_lie_on_the_surface_and_have_its_colors(photos):
    places, colors = swept_points(photos.views, 1000, (0.2, 0.7), generator())
    assert len(places) > 200
    off = (places.norm(dim=-1) - 1).abs()  # the globe's radius is 1
    assert off.median() < 0.05
    assert (off < 0.1).double().mean() > 0.8
    _, rows = distances(places, photos)
    error = (colors - photos.point_colors[rows]).abs().mean(-1)
    assert error.median() < 0.1
    assert colors.min() >= 0
    assert colors.max() <= 1


def test_what_has_no_texture_and_a_single_photo_give_no_points(photos):
    grey = [replace(v, image=torch.full_like(v.image, 0.5)) for v in photos.views]
    for views in (grey, photos.views[:1], [photos.views[0]] * 3):
        places, colors = swept_points(views, 500, (0.2, 0.7), generator())
        assert places.shape == colors.shape == (0, 3)


def test_masked_and_transparent_places_give_no_points(photos):
    left = torch.zeros(96, 96, dtype=torch.bool)
    left[:, :48] = True
    masked = [replace(v, mask=left) for v in photos.views]
    cut = [replace(v, alpha=left.float()) for v in photos.views]
    whole, _ = swept_points(photos.views, 500, (0.2, 0.7), generator())
    for views in (masked, cut):
        places, _ = swept_points(views, 500, (0.2, 0.7), generator())
        assert 0 < len(places) < 0.75 * len(whole)


def test_a_start_without_points_is_where_the_photos_agree(photos):
    bare = replace(photos, points=None, point_colors=None)
    scene = initial_scene(bare, 0, generator(), swept=1000)
    assert len(scene) > 200
    assert (scene.means.norm(dim=-1) - 1).abs().median() < 0.1
    again = initial_scene(bare, 0, generator(), swept=1000)
    assert torch.equal(scene.means, again.means)
