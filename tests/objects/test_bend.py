"""Bending: rigid motions are exact, what is outside keeps its bits, folds are refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from plain_scenes import same_bits

from gsedit.change.objects.bending.bend import Handle, bend, carried
from gsedit.errors import UsageError
from gsedit.scene.quaternions import axis_rotation
from gsedit.scene.similarity import Similarity
from gsedit.toolkit.transform import transform
from gsedit.views.depth import point_at
from rasterizer.camera import look_at
from rasterizer.harmonics import basis
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

AXIS, DEGREES, SHIFT = np.array((0.3, -1.0, 0.5)), 55.0, np.array((0.4, -0.2, 1.1))


def bar(count=1500, seed=0, degree=2):
    """A solid bar along x, 4 by 0.4 by 0.4, of flat and long Gaussians of many colors."""
    g = torch.Generator().manual_seed(seed)
    means = (torch.rand(count, 3, generator=g) - 0.5) * torch.tensor((4.0, 0.4, 0.4))
    return Gaussians(
        means,
        torch.randn(count, 4, generator=g),
        torch.randn(count, 3, generator=g) - 4,
        torch.zeros(count),
        0.3 * torch.randn(count, (degree + 1) ** 2, 3, generator=g),
    )


def all_of(scene):
    return torch.ones(len(scene), dtype=torch.bool)


def covariances(scene):
    turned = rotation_matrices(scene.quats.double()) * scene.log_scales.double().exp()[:, None]
    return turned @ turned.mT


def handle(point, map_of):
    x, y, z = map_of(np.array(point, np.float64)).tolist()
    return Handle(point, (x, y, z))


def rigid(point):
    return axis_rotation(AXIS, DEGREES) @ point + SHIFT


@pytest.mark.parametrize(
    "handles",
    [
        [handle(p, rigid) for p in ((-2.0, 0.0, 0.0), (2.0, 0.1, 0.0), (0.0, 0.2, -0.2))],
        [
            Handle((0.0, 0.0, 0.0), tuple(SHIFT.tolist()), 0.5,
                   tuple((DEGREES * AXIS / np.linalg.norm(AXIS)).tolist()))
        ],
    ],
)  # fmt: skip
def test_a_rigid_motion_of_the_handles_is_transform(handles):
    scene = bar()
    after = bend(scene, all_of(scene), handles).scene
    expected = transform(scene, Similarity(axis_rotation(AXIS, DEGREES), 1.0, SHIFT))
    assert torch.allclose(after.means, expected.means, atol=1e-5)
    sizes = covariances(expected).flatten(1).norm(dim=1)[:, None, None]
    assert ((covariances(after) - covariances(expected)) / sizes).abs().max() < 1e-5
    ways = torch.randn(50, 3, generator=torch.Generator().manual_seed(0))
    ways = torch.nn.functional.normalize(ways, dim=-1)
    shown = basis(ways, 2)
    assert torch.allclose(
        torch.einsum("vk,nkc->nvc", shown, after.sh),
        torch.einsum("vk,nkc->nvc", shown, expected.sh), atol=1e-5,
    )  # fmt: skip


def test_handles_at_rest_change_nothing():
    scene = bar()
    still = [Handle(p, p) for p in ((-2.0, 0.0, 0.0), (2.0, 0.0, 0.0))]
    after = bend(scene, all_of(scene), still)
    assert not after.changed.any()
    assert torch.equal(after.scene.means, scene.means)


def bent_up():
    return [
        Handle((-2.0, 0.0, 0.0), (-2.0, 0.0, 0.0), 0.4),
        Handle((2.0, 0.0, 0.0), (0.9, 0.0, 2.0), 0.4, (0.0, -80.0, 0.0)),
    ]


def test_targets_are_reached_and_volume_is_about_kept():
    scene = bar(3000)
    after = bend(scene, all_of(scene), bent_up()).scene
    moved = carried_volume(scene, after)
    assert abs(float(moved.median()) - 1) < 0.05
    assert abs(float(moved.mean()) - 1) < 0.1
    end = scene.means[:, 0] > 1.8
    turn = torch.from_numpy(axis_rotation(np.array((0.0, -1.0, 0.0)), 80.0)).float()
    expected = (scene.means[end] - torch.tensor((2.0, 0, 0))) @ turn.T + torch.tensor((0.9, 0, 2.0))
    assert (after.means[end] - expected).norm(dim=1).max() < 0.05


def carried_volume(before, after):
    return (after.log_scales.sum(1) - before.log_scales.sum(1)).double().exp()


def test_nothing_outside_of_the_cage_or_the_region_changes():
    scene = bar()
    cage, inside = scene.means[:, 0] > 0, scene.means[:, 1] > -0.15
    pull = [Handle((2.0, 0.0, 0.0), (1.8, 0.0, 0.6))]
    after = bend(scene, inside, pull, cage)
    still = ~(cage & inside)
    assert after.changed.any()
    assert not (after.changed & still).any()
    assert same_bits(after.scene[still], scene[still])
    far = (scene.means[:, 0] > 1.8) & inside
    assert (after.scene.means - scene.means)[far, 2].mean() > 0.4
    seam = (scene.means[:, 0] > 0) & (scene.means[:, 0] < 0.1) & inside
    assert (after.scene.means - scene.means)[seam].norm(dim=1).max() < 0.02


def test_covariances_follow_the_jacobian_of_needles_and_discs():
    scene = bar(40)
    scales = torch.tensor(((-2.0, -14.0, -14.0), (-2.0, -2.0, -16.0))).repeat(20, 1)
    scene = replace(scene, log_scales=scales)
    jacobians = np.eye(3) + 0.3 * np.random.default_rng(0).normal(size=(40, 3, 3))
    jacobians[np.linalg.det(jacobians) < 0.1] = np.eye(3)
    after = carried(scene, scene.means.double().numpy(), jacobians)
    j = torch.from_numpy(jacobians)
    expected = j @ covariances(scene) @ j.mT
    assert torch.allclose(covariances(after), expected, atol=1e-6 * float(expected.max()))
    volume = torch.linalg.det(j).abs()
    assert torch.allclose(carried_volume(scene, after), volume, rtol=1e-4)


@pytest.mark.parametrize(
    ("handles", "message"),
    [
        ([], "no handle"),
        ([Handle((0.0, 0, 0), (0.0, 0, 1)), Handle((0.0, 0, 0), (0.0, 1, 0))], "two places"),
        ([Handle((50.0, 0, 0), (0.0, 0, 1))], "from what is inside"),
        ([Handle((float("nan"), 0, 0), (0.0, 0, 1))], "finite"),
        (
            [Handle((-2.0, 0, 0), (2.0, 0, 0), 0.7), Handle((2.0, 0, 0), (-2.0, 0, 0), 0.7),
             Handle((0.0, 0, 0), (0.0, 0, 0), 0.7)],
            "fold space",
        ),
    ],
)  # fmt: skip
def test_handles_that_cannot_be_are_refused(handles, message):
    scene = bar()
    with pytest.raises(UsageError, match=message):
        bend(scene, all_of(scene), handles)


def test_a_click_is_the_point_of_the_surface():
    scene = replace(bar(3000), logit_opacities=torch.full((3000,), 3.0))
    eye, middle, up = (torch.tensor(each).double() for each in ((0, -5, 0), (0, 0, 0), (0, 0, 1)))
    camera = look_at(eye, middle, up, 50.0, 101, 101)
    place = point_at(scene, camera, 50.5, 50.5)
    assert place.tolist() == pytest.approx([0, -0.1, 0], abs=0.2)
    with pytest.raises(UsageError, match="nothing is seen"):
        point_at(scene, camera, 50.5, 2.5)
    with pytest.raises(UsageError, match="outside"):
        point_at(scene, camera, 101.5, 2.5)
