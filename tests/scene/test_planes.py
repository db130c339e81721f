"""Planes fitted to points, also where the points do not decide it; what an object stands on."""

import numpy as np
import pytest
from labelled import statue

from gsedit.scene.neighbors import extent_of
from gsedit.scene.planes import find_support, refined_plane


@pytest.mark.parametrize("across", [0.0, 1e-9, 1.0])
def test_a_fitted_plane_has_a_normal_of_length_1_also_for_points_in_a_line(across):
    line = np.zeros((9, 3))
    line[:, 0] = np.linspace(0, 1, 9)
    line[::2, 1] = across
    normal, offset = refined_plane(line, np.array([0.0, 0.0, 1.0]), 0.0, 0.1)
    assert np.linalg.norm(normal) == pytest.approx(1)
    assert np.abs(line @ normal - offset).max() < 0.1


def test_a_figure_stands_on_the_top_of_its_block():
    labelled = statue(0, 1500)
    points, subject = labelled.gaussians.means.numpy(), labelled.subject.numpy()
    support = find_support(points, subject, np.ones(len(points)))
    assert support is not None
    np.testing.assert_allclose(support.normal, (0, 0, 1), atol=0.02)
    top = -0.32  # of the block in `statue`, whose Gaussians are just below its surface
    assert abs(support.offset - top) < 0.02 * extent_of(points[subject])
    assert (support.heights(points[subject]) > support.band).mean() > 0.99


def test_a_ball_in_a_cloud_stands_on_nothing():
    random = np.random.default_rng(1)
    points = random.uniform(-1, 1, (3000, 3))
    ball = np.linalg.norm(points, axis=1) < 0.5
    assert find_support(points, ball, np.ones(len(points))) is None
    assert find_support(points[ball], ball[ball], np.ones(ball.sum())) is None


@pytest.mark.parametrize(
    ("slope", "drop", "level"),
    [(0.3, 0.1, 3000), (1.0, 0.4, 1500)],
    ids=["tilted, as many votes", "steep, five times as many"],
)
def test_of_a_level_and_a_sloping_plane_the_level_one_carries(slope, drop, level):
    random, up = np.random.default_rng(0), np.array((0.0, 0.0, 1.0))
    ball = random.uniform((-0.4, -0.4, 0.1), (0.4, 0.4, 0.9), (2000, 3))
    x, y = random.uniform(-1, 1, (2, 6000 if level == 3000 else 9000))
    flat, sloping = (np.stack((x, y, z), 1) for z in (0 * x, slope * x - drop))
    points = np.concatenate((ball, flat[:level], sloping[level:]))
    support = find_support(points, np.arange(len(points)) < len(ball), np.ones(len(points)), up)
    assert support is not None
    assert support.normal @ up > 0.999
