"""Views of a scene without cameras: found where it looks as if it was captured."""

from __future__ import annotations

import torch
from plain_scenes import discs

from gsedit.scene.table import table_of
from gsedit.toolkit.align import AlignToGround
from gsedit.views import search
from gsedit.views.around import find_up, find_views
from gsedit.views.orbit import perpendicular
from gsedit.views.paths import up_of
from gsedit.views.search import SearchEffort, ViewConstraints
from rasterizer import Gaussians, concatenate

HALF = torch.tensor([2.5, 2.0, 1.25])  # of the room; z is up


def splats(means: torch.Tensor, scales: torch.Tensor) -> Gaussians:
    n = len(means)
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(n, 1)
    color = torch.rand(n, 1, 3, generator=torch.Generator().manual_seed(1)) - 0.5
    return Gaussians(means, quats, scales.log(), torch.full((n,), 4.0), color)


def room(spacing: float = 0.16) -> Gaussians:
    """Six sides of small discs, a cupboard, and outside it large splats, which hide it."""
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            counts = [max(2, int(2 * float(h) / spacing)) for h in HALF]
            counts[axis] = 1
            lines = [torch.linspace(-1, 1, n) if n > 1 else torch.tensor([sign]) for n in counts]
            points = torch.cartesian_prod(*(line.float() for line in lines)) * HALF
            scales = torch.full_like(points, 0.7 * spacing)
            scales[:, axis] *= 0.1
            sides.append(splats(points, scales))
    g = torch.Generator().manual_seed(2)
    cupboard = torch.rand(400, 3, generator=g) * torch.tensor([0.6, 1.0, 1.2])
    sides.append(splats(cupboard - HALF, torch.full((400, 3), 0.06)))
    outside = torch.nn.functional.normalize(torch.randn(150, 3, generator=g), dim=-1)
    outside = outside * (HALF.norm() + 0.8 + torch.rand(150, 1, generator=g))
    return concatenate(*sides, splats(outside, torch.full((150, 3), 0.7)))


FEW = SearchEffort(60, 8, 60, 32)
"""Fewer places and renders: the room is easy."""


def test_a_room_is_seen_from_inside_and_upright():
    cameras = find_views(room(), 8, 64, effort=FEW)
    assert len(cameras) == 8
    for camera in cameras:
        assert (camera.center.float().abs() < HALF).all()
        assert (camera.width, camera.height) == (64, 64)
    tops = torch.stack([-camera.rotation[1] for camera in cameras])
    across = torch.tensor([camera.forward[2].abs() < 0.99 for camera in cameras])
    assert (tops[across, 2] > 0).all()
    assert float(tops[across].mean(0)[2]) > 0.7
    forwards = torch.stack([camera.forward for camera in cameras])
    assert float((forwards @ forwards.T).min()) < 0.5  # not all the same


def test_wishes_are_kept():
    eye, target = torch.tensor([1.0, 0.5, 0.0]), torch.tensor([-2.0, -1.5, -0.8])
    up = torch.tensor([0.0, 0.0, 2.0])
    first, *others = find_views(room(), 4, 32, wish=ViewConstraints(up, target, eye), effort=FEW)
    assert torch.allclose(first.center.float(), eye, atol=1e-6)
    for camera in (first, *others):
        aim, depth = camera.project(target.double())
        assert float(depth) > 0
        assert torch.allclose(aim, torch.tensor([16.0, 16.0]).double(), atol=1e-4)
        assert float(-camera.rotation[1, 2]) > 0
        assert float((camera.center.float() - eye).norm()) < 2


def test_an_object_alone_is_seen_from_around_it():
    g = torch.Generator().manual_seed(3)
    ball = torch.nn.functional.normalize(torch.randn(900, 3, generator=g), dim=-1)
    ball = ball * torch.rand(900, 1, generator=g) ** (1 / 3)  # hollow, it would be a room
    cameras = find_views(splats(ball, torch.full_like(ball, 0.08)), 4, 32, effort=FEW)
    assert all(camera.center.norm() > 1.5 for camera in cameras)
    assert float(torch.stack([c.center for c in cameras]).mean(0).norm()) < 1.5


def test_a_subject_is_seen_from_all_sides_above_its_ground_in_any_frame():
    g, line = torch.Generator().manual_seed(4), 0.1 * torch.linspace(-4, 4, 40)
    frame, middle = torch.linalg.qr(torch.randn(3, 3, generator=g))[0], torch.tensor([7.0, -8, 9])
    outward = torch.nn.functional.normalize(torch.randn(1800, 3, generator=g), dim=-1)
    ground, up = torch.cartesian_prod(line, line, torch.tensor([-0.05])) @ frame, frame[2]
    far = 1.2 * outward[1400:][outward[1400:] @ up > -0.05]
    scene = concatenate(
        discs(middle + 0.05 * outward[:1400], outward[:1400], 0.003),
        discs(middle + ground, up.expand(1600, 3), 0.012),
        splats(middle + far, torch.full_like(far, 0.15)),
    )
    cameras, again = (find_views(scene, 8, 32) for _ in range(2))
    assert all(torch.equal(x.world_to_camera, y.world_to_camera) for x, y in zip(cameras, again))
    assert float(up_of(cameras).float() @ up) > 0.99
    offsets = torch.stack([camera.center for camera in cameras]).float() - middle
    assert (offsets @ up > 0.01).all()
    assert float(offsets.norm(dim=-1).amax()) < 0.4
    assert float((offsets.mean(0) - offsets.mean(0) @ up * up).norm()) < 0.05
    turned = AlignToGround().find(table_of(scene), print).matrix[:3, :3] @ up.double().numpy()
    assert turned[1] < -0.99


def test_up_is_the_normal_of_the_ground_not_of_a_wall_that_is_faced():
    g = torch.Generator().manual_seed(0)
    up = torch.nn.functional.normalize(torch.tensor([0.2, -1.0, 0.3]).double(), dim=0)
    forward = perpendicular(up)
    ground, wall = up.expand(100, 3), -forward.expand(300, 3)
    noise = 0.05 * torch.randn(400, 3, generator=g, dtype=torch.float64)
    normals = torch.nn.functional.normalize(torch.cat((ground, wall)) + noise, dim=-1)
    found = find_up(search.directions_around(1000).double(), normals, forward[None])
    assert found is not None
    assert float(found @ up) > 0.995
    assert find_up(search.directions_around(1000).double(), wall, forward[None]) is None


def test_a_stray_row_does_not_move_the_views_away():
    scene = concatenate(room(), splats(torch.tensor([[9e8, -9e8, 9e8]]), torch.full((1, 3), 1e9)))
    for camera in find_views(scene, 4, 32, effort=FEW):
        assert camera.world_to_camera.isfinite().all()
        assert camera.center.norm() < 10 * HALF.norm()
