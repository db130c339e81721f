"""Sizes: exact where points are, and intervals that hold the truth on a scene of known surfaces."""

from math import pi, sqrt

import numpy as np
import pytest
import torch
import trimesh

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.errors import UsageError
from gsedit.mesh import Mesh
from gsedit.mesh.sizes import SurfacePoint, area, distance, ground_of, height, point_at, volume
from gsedit.scene.planes import Plane


def points(*positions, sigma=0.0):
    return [SurfacePoint(np.array(each, float), sigma) for each in positions]


def test_distances_and_areas_are_those_of_geometry():
    assert distance(*points((0, 0, 0), (3, 4, 0))).value == pytest.approx(5)
    square = points((1, 1, 2), (3, 1, 2), (3, 4, 2), (1, 4, 2))
    assert area(square).value == pytest.approx(6)
    assert area(square[::-1]).power == 2
    circle = [(np.cos(a), 0.0, np.sin(a)) for a in np.linspace(0, 2 * pi, 200, endpoint=False)]
    assert area(points(*circle)).value == pytest.approx(pi, rel=1e-3)


def test_errors_of_points_add_up():
    size = distance(*points((0, 0, 0), (5, 0, 0), sigma=0.1))
    assert size.sigma == pytest.approx(0.1 * sqrt(2), rel=1e-4)
    assert size.interval == pytest.approx((5 - 1.96 * size.sigma, 5 + 1.96 * size.sigma))
    assert str(size) == "5.00 ± 0.28 units (95 %)"
    ground = Plane(np.array([0.0, 0.0, 1.0]), 1.0, 0.5)
    above = height(points((0, 0, 4), sigma=0.3)[0], ground, 0.4)
    assert (above.value, above.sigma) == pytest.approx((3, 0.5))


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        (lambda: distance(*points((1, 1, 1), (1, 1, 1))), "two points are one"),
        (lambda: area(points((0, 0, 0), (1, 0, 0))), "three corners"),
        (lambda: area(points((0, 0, 0), (1, 0, 0), (2, 0, 0))), "on a line"),
    ],
)
def test_what_has_no_size_is_told(measured, message):
    with pytest.raises(UsageError, match=message):
        measured()


@pytest.fixture(scope="module")
def room():
    scene = demo_scene()
    gaussians = surface_gaussians(scene, 4000, torch.Generator().manual_seed(1))
    return scene, gaussians, ring_cameras(scene, 10, 96)


def test_intervals_of_distances_hold_the_truth(room):
    scene, gaussians, cameras = room
    random = np.random.default_rng(0)
    found = []
    for camera in cameras[:4]:
        exact = scene.trace(camera).depth
        for x, y in random.integers(20, 76, (12, 2)) + 0.5:
            depth = exact[int(y), int(x)]
            if not torch.isfinite(depth) or depth <= 0:
                continue
            try:
                point = point_at(gaussians, camera, x, y, cameras)
            except UsageError:
                continue
            pixel = torch.tensor([x, y], dtype=torch.float64)
            found.append((point, camera.unproject(pixel, depth.double()).numpy()))
    assert len(found) > 20
    inside, wide = [], []
    for (a, true_a), (b, true_b) in zip(found, [*found[5:], *found[:5]], strict=True):
        size, exact = distance(a, b), np.linalg.norm(true_a - true_b)
        low, high = size.interval
        inside.append(low <= exact <= high)
        wide.append(size.sigma / exact)
    assert np.mean(inside) >= 0.9
    assert np.median(wide) < 0.08


def test_the_ground_is_found_and_how_flat_it_is(room):
    scene, gaussians, _ = room
    plane, sigma = ground_of(gaussians, scene.up.double().numpy())
    assert plane.normal @ scene.up.double().numpy() > 0.99
    assert 0 <= sigma < 0.1


def test_a_volume_is_that_of_the_closed_mesh_of_what_is_selected(room, monkeypatch):
    _, gaussians, cameras = room
    solid, asked = trimesh.creation.box((2, 3, 4)), []

    def mesh(scene, cameras, *, inside, watertight):
        asked.append((inside, watertight))
        return Mesh(np.array(solid.vertices), np.array(solid.faces))

    monkeypatch.setattr("gsedit.mesh.build.mesh", mesh)
    flags = torch.ones(len(gaussians), dtype=torch.bool)
    found = volume(gaussians, cameras, flags)
    assert (found.value, found.power) == (pytest.approx(24), 3)
    assert found.sigma > 0
    assert asked == [(flags, True)]
