"""Rotations, positions on the picture and their inverse: exact in both dtypes."""

import pytest
import torch
from closeness import relative, weights_like
from gsplat_call import cloud, ortho

from gsedit.bench.renderer.stability import EDGE_CASES
from rasterizer import Numerics
from rasterizer.project import project, rotation_matrices

DTYPES = (torch.float32, torch.float64)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("exponent", [-300, -150, -30, -12, 3, 30, 150, 300])
def test_rotations_do_not_depend_on_the_norm(dtype, exponent):
    unit = torch.tensor([[0.5, -0.5, 0.1, 0.7]], dtype=torch.float64)
    norm = max(10.0**exponent, 1e-30) if dtype == torch.float32 else 10.0**exponent
    norm = min(norm, 1e30) if dtype == torch.float32 else norm
    quats = (unit * norm).to(dtype).requires_grad_()
    found = rotation_matrices(quats)
    eps = torch.finfo(dtype).eps
    assert (found - rotation_matrices(unit)).abs().max() < 8 * eps  # products of rounded entries
    found = torch.autograd.grad((found * weights_like(found)).sum(), quats)[0]
    plain = unit.clone().requires_grad_()
    turned = rotation_matrices(plain)
    exact = torch.autograd.grad((turned * weights_like(turned)).sum(), plain)[0]
    if norm < 1e-292:
        assert (found == 0).all()  # 1 / norm is no float64
    else:
        assert relative(found.double() * norm, exact) < 32 * eps


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_the_zero_quaternion_is_the_identity_without_gradient(dtype):
    quats = torch.zeros(1, 4, dtype=dtype, requires_grad=True)
    found = rotation_matrices(quats)
    assert (found == torch.eye(3)).all()
    assert (torch.autograd.grad((found * weights_like(found)).sum(), quats)[0] == 0).all()


def test_positions_far_from_the_origin_keep_the_digits_that_are_left():
    case = next(case for case in EDGE_CASES if case.name == "1e7 from the origin")
    scene, view, _ = case.make(torch.float32)
    found = project(scene, view, Numerics()).xy
    wanted = project(scene.to(torch.float64), view, Numerics()).xy
    seen = wanted.abs().amax(1) < 100
    assert seen.sum() > 50
    assert (found - wanted)[seen].abs().max() < 1e-5  # float32 of a pixel's position, once


def test_an_orthographic_camera_projects_and_unprojects():
    view = ortho()
    points = cloud().means
    xy, depth = view.project(points)
    wanted = points[:, :2] * xy.new_tensor([8.0, 8.4]) + xy.new_tensor([20.8, 15.04])
    assert torch.allclose(xy, wanted)
    assert torch.equal(depth, points[:, 2])
    assert torch.allclose(view.unproject(xy, depth), points)
    assert view.resized(80, 64).model == "ortho"
