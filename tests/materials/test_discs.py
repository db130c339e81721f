"""Discs on the surface of a part: where they lie, how they face, what metals and glass show."""

from dataclasses import replace

import pytest
import torch
from plain_scenes import discs, needles, ring

from gsedit.change.materials.apply import in_material, study
from gsedit.change.materials.material import MATERIALS
from gsedit.scene.cache import SceneCache
from gsedit.scene.quaternions import even_directions
from gsedit.views.discs import discs_on
from gsedit.views.surroundings import DARKEST, contrasted, studio
from rasterizer.numerics import color_to_sh
from rasterizer.render import render, render_picture
from rasterizer.scene import concatenate

UP = torch.tensor((0.0, 0.0, 1.0))
CAMERAS = [*ring(5, 2.0, 0.0), *ring(5, -1.5, 0.0)]


def rough_ball(wide, count):
    """Needles on a ball of radius 0.5, turned at random about their places, a little off it."""
    generator = torch.Generator().manual_seed(5)
    normals = torch.from_numpy(even_directions(count)).float()
    off = 1 + 0.02 * torch.randn(count, 1, generator=generator)
    ball = discs(0.5 * off * normals, normals, 0.035)
    turned = ball.quats + 0.3 * torch.randn(count, 4, generator=generator)
    sizes = (wide * torch.tensor((0.05, 0.018, 0.008))).log().expand(count, 3).clone()
    return replace(ball, quats=turned, log_scales=sizes), normals


def degrees(found, truth):
    return torch.rad2deg(torch.acos((found * truth).sum(-1).clamp(-1, 1)))


@pytest.fixture(scope="module")
def ball():
    made = rough_ball(2.3, 1500)  # coarser discs, and fewer
    with SceneCache(made[0]).used():
        yield made


def test_discs_on_a_noisy_ball_lie_on_it_and_face_outwards():
    scene, _ = rough_ball(1.5, 1500)
    laid = discs_on(scene, CAMERAS)
    assert laid is not None
    truth = torch.nn.functional.normalize(laid.scene.means, dim=-1)
    assert float(degrees(laid.normals, truth).median()) < 12
    every = torch.ones(len(scene), dtype=torch.bool)
    known = study(scene, every, CAMERAS, matte=True, fresh=True)
    truth = torch.nn.functional.normalize(known.skin.points, dim=-1)
    assert float(degrees(known.skin.normals, truth).median()) < 8
    assert float((laid.scene.means.norm(dim=-1) - 0.5).abs().median()) < 0.05
    assert laid.covered.float().mean() > 0.9


def test_needles_in_a_box_keep_their_places():
    lost = needles(400)
    laid = discs_on(replace(lost, logit_opacities=torch.full((400,), -4.0)), CAMERAS)
    assert laid is None


def test_a_metal_has_highlights_and_dark_edges(ball):
    scene, _ = ball
    made = in_material(scene, torch.ones(len(scene), dtype=torch.bool), MATERIALS["bronze"])
    shown = render_picture(made.scene, CAMERAS[0]).mean(-1) ** 2.2
    lit = shown[render_picture(scene, CAMERAS[0]).mean(-1) > 0.3]
    low, high = lit.quantile(torch.tensor((0.1, 0.97)))
    assert float(high) > 2.5 * float(lit.mean())
    assert float(low) < 0.4 * float(lit.mean())


def test_a_thin_spike_on_a_ball_keeps_its_gaussians_and_the_ball_gets_discs(ball):
    scene, _ = ball
    spike = scene.means[:60] * 0.02 + torch.linspace(0.5, 1.1, 60)[:, None] * UP
    small = replace(scene[:60], means=spike, log_scales=scene.log_scales[:60] - 1.8)
    both = concatenate(scene, small)
    made = in_material(both, torch.ones(len(both), dtype=torch.bool), MATERIALS["gold"])
    kept = (made.scene.means[:, None] == spike).all(-1).any(0)
    assert kept[20:].float().mean() > 0.9
    assert torch.isin(made.scene.means[:, 0], scene.means[:, 0]).float().mean() < 0.1


def test_glass_lets_what_is_behind_it_through(ball):
    scene, _ = ball
    every, near = torch.ones(len(scene), dtype=torch.bool), CAMERAS[0].resized(512, 512)
    clear, solid = (
        render(in_material(scene, every, MATERIALS[name]).scene, near).alpha[256, 256]
        for name in ("glass", "gold")
    )
    assert 0.2 < float(clear) < 0.8
    assert float(solid) > 0.98


def test_a_dark_eye_keeps_its_contrast_in_marble(ball):
    scene, normals = ball
    eye = normals @ torch.nn.functional.normalize(torch.tensor((0.0, -1.0, 0.4)), dim=0) > 0.985
    color = torch.where(eye[:, None], 0.12, 0.6).expand(-1, 3)
    painted = replace(scene, sh=color_to_sh(color[:, None].clone()))
    every = torch.ones(len(scene), dtype=torch.bool)
    plain, seeing = (in_material(each, every, MATERIALS["marble"]) for each in (scene, painted))
    pictures = [render_picture(each.scene, CAMERAS[0]).mean(-1) for each in (plain, seeing)]
    darker = (pictures[0] - pictures[1]) / pictures[0].clamp_min(0.1)
    assert float(darker.amax()) > 0.2


def test_carving_that_is_color_all_over_stays_in_gold(ball):
    scene, normals = ball
    color = torch.where((30 * normals[:, 2:]).sin() > 0, 0.12, 0.6).expand(-1, 3)
    carved = replace(scene, sh=color_to_sh(color[:, None].clone()))
    made = in_material(carved, torch.ones(len(scene), dtype=torch.bool), MATERIALS["gold"])
    pictures = [render_picture(each, CAMERAS[0]).mean(-1) for each in (carved, made.scene)]
    shown = [each - each.roll(3, 0) for each in pictures]
    inside = pictures[0] > 0.08
    assert float(torch.corrcoef(torch.stack([each[inside] for each in shown]))[0, 1]) > 0.5


def test_poor_surroundings_get_highlights_and_a_lamp_over_flat_tops():
    light = studio(torch.zeros(3), UP)
    even = replace(light, radiance=torch.full_like(light.radiance, 0.4))
    richer, mixed = contrasted(even, UP, 2.0)
    assert mixed
    assert float(richer.distance.amin()) == pytest.approx(2, rel=0.01)  # over a flat top
    ratio = richer.radiance.mean(-1)
    assert float(ratio.amax()) > 4 * 0.4
    assert float(ratio.quantile(0.1)) < DARKEST * 0.4 * 1.2
