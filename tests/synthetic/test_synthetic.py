"""The synthetic scenes are exact, and their Gaussians lie where the surface is."""

from __future__ import annotations

import math

import pytest
import torch
from matching import correspondence
from small_scenes import scenes

from gsedit.bench.synthetic import (
    SyntheticScene,
    demo_scene,
    ring_cameras,
    surface_gaussians,
    surface_points,
)
from gsedit.bench.synthetic.paint import mix, plain, waves
from gsedit.bench.synthetic.shapes import (
    box,
    capsule,
    cylinder,
    gradient,
    mirror,
    rotate,
    smooth_union,
    sphere,
    torus,
    translate,
    union,
)
from rasterizer import render
from rasterizer.numerics import SH_DC

ALL = {scene.name: scene for scene in (*scenes(), demo_scene())}
EXACT = 1e-9  # world units; the tracer stops at 1e-13, a projection adds roundings of its own

every_scene = pytest.mark.parametrize("scene", ALL.values(), ids=ALL.keys())


def cloud(n: int, reach: float = 1.5, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return (2 * torch.rand((n, 3), generator=generator, dtype=torch.float64) - 1) * reach


def ball_scene() -> SyntheticScene:
    up, grey = torch.tensor((0.0, 0.0, 1.0)), torch.tensor((0.5, 0.5, 0.5))
    paint = mix(plain((0.1, 0.2, 0.9)), plain((0.9, 0.6, 0.1)), waves(0.8))
    center = (0.3, -0.2, 0.1)
    return SyntheticScene("ball", sphere(0.7, center), paint, grey, radius=1.2, up=up)


SOLIDS = {
    "sphere": sphere(0.6, (0.1, 0.2, -0.3)),
    "box": box((0.3, 0.5, 0.7), rounding=0.1),
    "torus": torus(0.7, 0.2),
    "capsule": capsule((-0.3, 0.1, 0), (0.5, 0.4, 0.6), 0.2),
    "cylinder": cylinder(0.6, 0.3, rounding=0.05),
    "union": union(sphere(0.5), translate(torus(0.5, 0.1), (0.3, 0, 0))),
    "smooth_union": smooth_union(0.3, sphere(0.5), sphere(0.4, (0.6, 0, 0)), box((0.2, 0.2, 0.9))),
    "rotate": rotate(box((0.2, 0.4, 0.6)), (1, 1, 0), 35.0),
    "mirror": mirror(capsule((0.2, 0, 0), (0.6, 0.3, 0.1), 0.15)),
}


@pytest.mark.parametrize("solid", SOLIDS.values(), ids=SOLIDS.keys())
def test_signed_distances_are_1_lipschitz(solid):
    a, b = cloud(4000), cloud(4000, seed=1)
    near = a + 0.05 * (b - a)
    for other in (b, near):
        assert bool(((solid(a) - solid(other)).abs() <= (a - other).norm(dim=-1) + 1e-12).all())


def test_sphere_equals_its_closed_form():
    scene = ball_scene()
    camera = ring_cameras(scene, 3, 64)[1]
    traced = scene.trace(camera)
    eye = camera.center
    rays = torch.nn.functional.normalize(
        camera.unproject(camera.pixel_centers(), torch.ones(64, 64, dtype=torch.float64)) - eye,
        dim=-1,
    )
    offset = eye - torch.tensor((0.3, -0.2, 0.1), dtype=torch.float64)
    b, c = rays @ offset, offset @ offset - 0.7**2
    expected_hit = b * b - c > 0
    t = -b - (b * b - c).clamp_min(0).sqrt()
    depth = t * (rays @ camera.forward)
    assert torch.equal(traced.hit, expected_hit)
    assert 0 < int(traced.hit.sum()) < 64 * 64
    hit = traced.hit
    torch.testing.assert_close(traced.depth[hit], depth[hit], atol=EXACT, rtol=0)
    normals = (eye + t[..., None] * rays - eye + offset) / 0.7
    torch.testing.assert_close(traced.normal[hit], normals[hit], atol=1e-8, rtol=0)


@every_scene
def test_nothing_is_stepped_over(scene):
    """Nothing lies in front of any hit, checked by a walk in small steps."""
    camera = ring_cameras(scene, 3, 24)[1]
    traced = scene.trace(camera)
    xy, depth = camera.pixel_centers()[traced.hit], traced.depth[traced.hit]
    for share in torch.linspace(0.5, 0.999, 200).tolist():
        assert bool((scene.sdf(camera.unproject(xy, share * depth)) > 0).all())
    # and where nothing was hit, there is nothing
    xy = camera.pixel_centers()[~traced.hit]
    for z in torch.linspace(0.5, 4 * scene.radius, 200).tolist():
        points = camera.unproject(xy, torch.full((len(xy),), z, dtype=torch.float64))
        assert bool((scene.sdf(points)[points.norm(dim=-1) < scene.radius] > 0).all())


@every_scene
def test_correspondences_see_the_same_color(scene):
    cameras = ring_cameras(scene, 12, 32)
    a, b = cameras[0], cameras[1]
    xy = a.pixel_centers()
    xy_b, visible = correspondence(scene, a, xy, b)
    assert float(visible[scene.trace(a).hit].double().mean()) > 0.1
    assert not bool(visible[~scene.trace(a).hit].any())
    # the round trip ends where it began; at a silhouette a rounding may lose it
    xy_a, back = correspondence(scene, b, xy_b[visible], a)
    assert float(back.double().mean()) > 0.99
    torch.testing.assert_close(xy_a[back], xy[visible][back], atol=1e-3, rtol=0)
    # the colors that two perfect photos would show there
    seen_a = scene.albedo(a.unproject(xy, scene.trace(a).depth)[visible])
    seen_b = scene.trace(b.resized(32 * 8, 32 * 8)).image
    row, column = (xy_b[visible] * 8).long().flip(-1).unbind(-1)
    # a pixel of the finer picture is an eighth: nearly all of its centers are on the same paint
    assert float(((seen_a - seen_b[row, column]).abs().amax(-1) < 0.1).double().mean()) > 0.93


def test_supersampling_smooths_the_edge_and_leaves_the_depth():
    scene = ball_scene()
    camera = ring_cameras(scene, 1, 32)[0]
    coarse, fine = scene.trace(camera), scene.trace(camera, supersample=4)
    assert torch.equal(coarse.depth, fine.depth)
    assert set(coarse.alpha.unique().tolist()) == {0.0, 1.0}
    assert float(((fine.alpha > 0) & (fine.alpha < 1)).double().mean()) > 0.02
    # covered area against the exact cone: 16 samples a pixel on a rim of about 90 pixels
    assert float(fine.alpha.sum()) == pytest.approx(float(coarse.alpha.sum()), rel=0.03)
    inner = fine.alpha == 1
    assert float((coarse.image - fine.image)[inner].abs().mean()) < 0.02


@every_scene
def test_gaussians_lie_on_the_surface_along_it(scene):
    count = 1500
    generator = torch.Generator().manual_seed(3)
    points = surface_points(scene, count, generator)
    assert points.shape == (count, 3)
    assert float(scene.sdf(points).abs().max()) < 1e-6
    generator.manual_seed(3)
    splats = surface_gaussians(scene, count, generator, sh_degree=1, sink=0.0)
    assert splats.means.dtype == torch.float32
    assert splats.sh.shape == (count, 4, 3)
    assert torch.equal(splats.means, points.float())
    torch.testing.assert_close(
        0.5 + SH_DC * splats.sh[:, 0], scene.albedo(points).float(), atol=1e-6, rtol=0
    )
    # the thin axis, turned by the quaternion, is the normal
    w, x, y, z = torch.nn.functional.normalize(splats.quats.double(), dim=-1).unbind(-1)
    third = torch.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), -1)
    normal = torch.nn.functional.normalize(gradient(scene.sdf, points), dim=-1)
    assert float((third * normal).sum(-1).abs().min()) > 1 - 1e-6  # float32 quaternions
    assert torch.equal(splats.scales.argmin(-1), torch.full((count,), 2))


def test_points_are_even():
    scene = ball_scene()
    points = surface_points(scene, 1000, torch.Generator().manual_seed(0))
    distances = torch.cdist(points, points) + 9 * torch.eye(1000, dtype=torch.float64)
    spacing = math.sqrt(4 * math.pi * 0.7**2 / 1000)
    nearest = distances.amin(0) / spacing
    assert float(nearest.quantile(0.2)) > 0.7  # independent draws: 0.26
    probes = torch.nn.functional.normalize(cloud(5000, seed=5), dim=-1) * 0.7
    probes = probes + torch.tensor((0.3, -0.2, 0.1), dtype=torch.float64)
    assert float(torch.cdist(probes, points).amin(1).max()) < 1.3 * spacing  # no hole


@pytest.mark.parametrize("name", ["links", "pond"])
def test_gaussians_look_like_the_scene(name):
    scene = ALL[name]
    camera = ring_cameras(scene, 5, 128)[1]
    splats = surface_gaussians(scene, 10000, torch.Generator().manual_seed(0))
    traced = scene.trace(camera, supersample=2)
    drawn = render(
        splats, camera, background=scene.background.float(), depth=True, median_depth=True
    )
    error = (drawn.color.double() - traced.image).square().mean()
    assert -10 * math.log10(float(error)) > 25  # a disc is 1.5 pixels wide here; 28 and more at 30k
    inner = traced.alpha == 1
    assert float(drawn.alpha[inner].quantile(0.02)) > 0.97
    for depth in (drawn.depth, drawn.median_depth):
        assert depth is not None
        relative = ((depth.double() - traced.depth) / traced.depth)[inner & traced.hit].abs()
        assert float(relative.median()) < 0.005
