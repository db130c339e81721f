"""A picture does not depend on the scene's unit of length, where cameras are made for the scene."""

from dataclasses import replace
from math import log

import pytest
import torch
from point_clouds import ball

from gsedit import Dataset, View, orbit
from gsedit.scene.framing import framing_camera
from gsedit.views.around import find_views
from gsedit.views.search import SearchEffort
from gsedit.views.viewpoints import Viewpoint, dataset_near, viewpoints_near
from rasterizer import Execution, look_at, render

FEW = SearchEffort(places=30, kept=4, rendered=8)


def scaled(scene, factor):
    return replace(scene, means=scene.means * factor, log_scales=scene.log_scales + log(factor))


@pytest.mark.parametrize("factor", [1e-3, 1e3])
@pytest.mark.parametrize("kernel", ["torch", "auto"])
def test_found_views_show_the_same_in_any_unit(factor, kernel):
    scene, execution = ball(300), Execution(kernel=kernel)
    for make in (
        lambda each: find_views(each, 2, 32, effort=FEW),
        lambda each: orbit(each, 2, 32),
        lambda each: [framing_camera(each, size=(32, 32))],
    ):
        expected = [render(scene, view, execution=execution) for view in make(scene)]
        other = scaled(scene, factor)
        found = [render(other, view, execution=execution) for view in make(other)]
        for a, b in zip(expected, found, strict=True):
            assert a.alpha.mean() > 0.05
            assert (a.color - b.color).abs().max() < 1e-3


def test_given_cameras_keep_the_renderers_near_plane_unless_the_units_are_tiny():
    scene = ball(300)
    camera = look_at(
        torch.tensor([0.0, 0, -3]), torch.zeros(3), torch.tensor([0.0, -1, 0]), 50.0, 8, 8
    )
    (kept,) = viewpoints_near([Viewpoint("a", camera)], scene)
    assert kept.camera is camera
    (nearer,) = viewpoints_near([Viewpoint("a", camera)], scaled(scene, 1e-3))
    assert 0 < nearer.camera.near < 1e-4
    photo = View("a", camera, torch.zeros(8, 8, 3))
    for points, changed in ((None, False), (scene.means, False), (1e-3 * scene.means, True)):
        (view,) = dataset_near(Dataset((photo,), points)).views
        assert (view.camera.near is not None) == changed
