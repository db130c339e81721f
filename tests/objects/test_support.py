"""The plane that an object stands on, and its silhouette."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from regions_iou import iou
from research.labelled import statue

from gsedit.cameras.orbit import circle
from gsedit.objects.placing.support import find_support
from gsedit.scene.quantiles import extent_of
from gsedit.select.region import lift, within_silhouette

SIZE = 48


@pytest.fixture(scope="module")
def labelled():
    return statue(0, 1500)


@pytest.fixture(scope="module")
def cameras(labelled):
    middle = torch.zeros(3, dtype=torch.float64)
    return circle(middle, 0.7, labelled.scene.up, 6, SIZE, elevation=20.0, fov=45.0)


def test_a_figure_stands_on_the_top_of_its_block(labelled):
    points, subject = labelled.gaussians.means.numpy(), labelled.subject.numpy()
    support = find_support(points, subject, np.ones(len(points)))
    assert support is not None
    np.testing.assert_allclose(support.normal, (0, 0, 1), atol=0.02)
    top = -0.32  # of the block in `statue`, whose Gaussians are just below its surface
    assert abs(support.offset - top) < 0.02 * extent_of(points[subject])
    assert support.above(points)[subject].mean() > 0.99


def test_a_ball_in_a_cloud_stands_on_nothing():
    random = np.random.default_rng(1)
    points = random.uniform(-1, 1, (3000, 3))
    ball = np.linalg.norm(points, axis=1) < 0.5
    assert find_support(points, ball, np.ones(len(points))) is None
    assert find_support(points[ball], ball[ball], np.ones(ball.sum())) is None


def test_a_wide_gaussian_that_shows_beyond_the_silhouette_is_left_out(labelled, cameras):
    scene, inside = labelled.gaussians, labelled.subject
    narrow = within_silhouette(scene, cameras, inside)
    assert not (narrow & ~inside).any()
    assert iou(narrow, inside, lift(scene, cameras, [torch.ones(SIZE, SIZE)] * 6).weight) > 0.95
    one = int(narrow.nonzero()[0])
    log_scales, logits = scene.log_scales.clone(), scene.logit_opacities.clone()
    log_scales[one], logits[one] = float(np.log(0.5)), -1.0  # thin: no silhouette of its own
    wide = replace(scene, log_scales=log_scales, logit_opacities=logits)
    kept = within_silhouette(wide, cameras, inside)
    assert not kept[one]
    assert float(kept.float().mean()) > 0.9 * float(inside.float().mean())
    assert torch.equal(within_silhouette(wide, [], inside), inside)
