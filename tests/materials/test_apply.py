"""Materials at the ends of what there is: one Gaussian, no light, double precision."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from gsedit.materials.apply import in_material
from gsedit.materials.named import paint_of
from gsedit.materials.shading import lighting
from gsedit.surface.occlusion import nothing
from gsedit.surface.surroundings import studio
from gsedit.synthetic import demo_scene, surface_gaussians
from rasterizer import Gaussians, look_at
from rasterizer.render import backproject

PAINT = paint_of("matte teal", "#008080")


def a_scene(n: int = 400) -> Gaussians:
    return surface_gaussians(demo_scene(), n, torch.Generator().manual_seed(0))


def test_black_surroundings_leave_finite_light():
    scene = a_scene()
    around = studio(scene.means.mean(0), torch.tensor((0.0, 0.0, 1.0)))
    black = replace(around, radiance=torch.zeros_like(around.radiance))
    assert bool(lighting(black, nothing(scene)).maps.isfinite().all())


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
