"""Materials at the ends of what there is: one Gaussian, no light, double precision."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from bench.reflective import Finish, LitSolid, captured, garden, plain_base

from gsedit.materials.apply import in_material
from gsedit.materials.named import paint_of
from gsedit.materials.shading import lighting
from gsedit.materials.table import MATERIALS
from gsedit.surface.occlusion import nothing
from gsedit.surface.surroundings import studio
from gsedit.synthetic import demo_scene, ring_cameras, scenes, surface_gaussians
from rasterizer import Camera, Gaussians, look_at
from rasterizer.render import backproject

PAINT = paint_of("matte teal", "#008080")


def a_scene(n: int = 400) -> Gaussians:
    return surface_gaussians(demo_scene(), n, torch.Generator().manual_seed(0))


def _grown(camera: Camera) -> Camera:
    pose = camera.world_to_camera.clone()
    pose[:3, 3] *= 100
    return replace(camera, world_to_camera=pose)


def test_black_surroundings_leave_finite_light():
    scene = a_scene()
    around = studio(scene.means.mean(0), torch.tensor((0.0, 0.0, 1.0)))
    black = replace(around, radiance=torch.zeros_like(around.radiance))
    assert bool(lighting(black, nothing(scene)).maps.isfinite().all())


def test_a_larger_world_has_the_same_colors():
    lit = LitSolid(scenes()[0], garden)
    stone = Finish(plain_base((0.5, 0.45, 0.4)), specular=0.0)
    scene, own = captured(lit, stone, 300, 1000, torch.Generator().manual_seed(0))
    high = scene.means[:, 2] > 3  # nothing is known of the sky, as in a capture that looks down
    scene, own = scene[~high], own[~high]
    cameras = ring_cameras(lit.solid, 6, 48, elevation=30.0)
    larger = replace(scene, means=100 * scene.means, log_scales=scene.log_scales + math.log(100))
    made = in_material(scene, own, MATERIALS["gold"], cameras).scene
    grown = in_material(larger, own, MATERIALS["gold"], [_grown(c) for c in cameras]).scene
    torch.testing.assert_close(grown.sh, made.sh, atol=0.02, rtol=0)


def test_one_gaussian_is_painted():
    made = in_material(a_scene()[:1], torch.ones(1, dtype=torch.bool), PAINT)
    assert bool(made.scene.sh.isfinite().all())


def test_double_precision_is_painted_as_single():
    scene = a_scene()
    inside = torch.arange(len(scene)) < 200
    single = in_material(scene, inside, PAINT).scene.sh
    names = ("means", "log_scales", "quats", "logit_opacities", "sh")
    double = replace(scene, **{name: getattr(scene, name).double() for name in names})
    assert torch.allclose(in_material(double, inside, PAINT).scene.sh.float(), single, atol=0.02)


def test_maps_that_are_projected_back_have_the_size_of_the_picture():
    camera = look_at(
        torch.tensor((0.0, 0, 4)), torch.zeros(3), torch.tensor((0.0, 1, 0)), 50.0, 32, 24
    )
    with pytest.raises((TypeError, ValueError)):
        backproject(a_scene(), camera, torch.ones(10, 10, 3))
