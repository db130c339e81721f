"""Lists of what pixels show draw the picture that is rendered, with its gradients."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from rasterizer import render
from rasterizer.pixel_lists import blend, pixel_lists, shown_rows
from rasterizer.project import view_dependent_colors

BOX = (7, 20, 24, 19)


def ball(count):
    """A scene of surfaces, of view-dependent colors, and a camera that sees it."""
    random = torch.Generator().manual_seed(0)
    scene = surface_gaussians(demo_scene(), count, random)
    bands = 0.2 * torch.randn(len(scene), 8, 3, generator=random)
    sh = torch.cat((scene.sh[:, :1], bands), 1)
    logits = scene.logit_opacities.clamp_max(2) + torch.randn(len(scene), generator=random)
    return replace(scene, sh=sh, logit_opacities=logits), ring_cameras(demo_scene(), 1, 48)[0]


@pytest.fixture
def view():
    """A scene, a camera that sees it, and lists from which nothing is left out."""
    scene, camera = ball(300)
    return scene, camera, pixel_lists(scene, camera, least=0.0)


def drawn(lists, scene, start, camera):
    rows = shown_rows([lists], len(scene))
    places = torch.zeros(len(scene), dtype=torch.int32)
    places[rows] = torch.arange(len(rows), dtype=torch.int32)
    colors = view_dependent_colors(scene.sh[rows], scene.means[rows], camera)
    return blend(lists, places, colors, (scene.opacities / start.opacities)[rows])


def test_a_picture_of_other_colors_and_opacities_is_the_rendered_one(view):
    start, camera, lists = view
    fainter = torch.rand(len(start), generator=torch.Generator().manual_seed(0))
    scene = replace(start, sh=start.sh.flip(0), logit_opacities=start.logit_opacities - fainter)
    expected = render(scene, camera).color
    torch.testing.assert_close(drawn(lists, start, start, camera), render(start, camera).color)
    # what falls below the alpha floor of a renderer stays in the lists
    torch.testing.assert_close(drawn(lists, scene, start, camera), expected, rtol=0, atol=0.02)
    assert (drawn(lists, scene, start, camera) - expected).abs().mean() < 2e-3


def test_a_crop_is_that_part_of_the_picture(view):
    scene, camera, lists = view
    left, top, width, height = BOX
    part = drawn(lists, scene, scene, camera)[top : top + height, left : left + width]
    torch.testing.assert_close(drawn(lists.crop(BOX), scene, scene, camera), part)
    torch.testing.assert_close(part, render(scene, camera, crop=BOX).color)


def test_gradients_are_those_of_the_renderer(view):
    start, camera, lists = view
    gradients = []
    weights = torch.rand(BOX[3], BOX[2], 3, generator=torch.Generator().manual_seed(0))
    for crop in (True, False):
        sh, logits = start.sh.clone(), start.logit_opacities.clone()
        scene = replace(start, sh=sh.requires_grad_(), logit_opacities=logits.requires_grad_())
        if crop:
            picture = drawn(lists.crop(BOX), scene, start, camera)
        else:
            picture = render(scene, camera, crop=BOX).color
        (picture * weights).sum().backward()
        gradients.append((sh.grad, logits.grad))
    for one, other in zip(*gradients):
        torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-5)
