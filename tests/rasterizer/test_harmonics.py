"""Spherical harmonics: orthonormal, in INRIA's signs, and the color they give."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from gsplat_call import cloud, gsplat_arguments
from scenes import camera

from rasterizer import harmonics, rasterization
from rasterizer.harmonics import without_zero_bands


def sphere_quadrature(order: int = 12):
    """Nodes and weights that integrate polynomials of degree < 2 order over the sphere exactly."""
    import numpy as np

    z, wz = np.polynomial.legendre.leggauss(order)
    phi = np.arange(2 * order) * math.pi / order
    z, phi = (torch.from_numpy(a).flatten() for a in np.meshgrid(z, phi, indexing="ij"))
    weights = torch.from_numpy(wz).repeat_interleave(2 * order) * math.pi / order
    r = (1 - z * z).sqrt()
    return torch.stack((r * phi.cos(), r * phi.sin(), z), -1), weights


@pytest.mark.parametrize("degree", range(5))
def test_the_basis_is_orthonormal(degree):
    directions, weights = sphere_quadrature()
    values = harmonics.basis(directions, degree)
    gram = values.T @ (weights[:, None] * values)
    # the constants are written to 16 digits
    assert (gram - torch.eye((degree + 1) ** 2, dtype=torch.float64)).abs().max() < 1e-12


def test_degree_one_has_the_signs_of_splat_files():
    axes = torch.eye(3, dtype=torch.float64)
    values = harmonics.basis(axes, 1)[:, 1:]
    c = math.sqrt(3 / (4 * math.pi))
    wanted = torch.tensor([[0, 0, -c], [-c, 0, 0], [0, c, 0]], dtype=torch.float64)
    assert (values - wanted).abs().max() < 1e-15


def test_bands_that_are_zero_are_left_out():
    scene = cloud(4)
    sh = scene.sh.clone()
    sh[:, 4:] = 0
    assert without_zero_bands(sh).shape == (60, 4, 3)
    assert without_zero_bands(torch.zeros_like(sh)).shape == (60, 1, 3)
    assert without_zero_bands(scene.sh) is scene.sh
    late = torch.zeros(100, 25, 3)
    late[99, 24, 2] = 1e-30  # the last number of all
    assert without_zero_bands(late).shape == (100, 25, 3)
    # a zero has a gradient of its own: with one asked for, all bands stay
    assert without_zero_bands(sh.requires_grad_()).shape == (60, 25, 3)
    color, _, _ = rasterization(**gsplat_arguments(replace(scene, sh=sh), camera()))
    color.sum().backward()
    assert sh.grad is not None
    assert sh.grad[:, 4:].any()
    with torch.no_grad():
        again, _, _ = rasterization(**gsplat_arguments(replace(scene, sh=sh), camera()))
    assert (again - color).abs().max() < 1e-14
