"""`rasterization` prepares in the compiled front end what torch prepares: values and gradients."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from closeness import relative
from gsplat_call import cloud, gsplat_arguments, loss_of, ortho
from scenes import camera

from rasterizer import Execution, rasterization
from rasterizer.cpp_projection import kernel, picture

if kernel.load() is None:
    pytest.skip("no C++ compiler on this machine", allow_module_level=True)
INPUTS = ("means", "quats", "scales", "opacities", "colors")
CASES = {
    "harmonics": ({}, 2, camera()),
    "degree 0, expected depth": ({"render_mode": "RGB+ED"}, 0, camera()),
    "degree 4, depth": ({"render_mode": "RGB+D"}, 4, camera()),
    "depth alone": ({"render_mode": "D"}, 1, camera()),
    "features": ({"render_mode": "RGB+D"}, None, camera()),
    "antialiased": ({"rasterize_mode": "antialiased", "radius_clip": 3.0}, 1, camera()),
    "planes and blur": ({"near_plane": 2.5, "far_plane": 5.5, "eps2d": 1.5}, 1, camera()),
    "ortho": ({"camera_model": "ortho"}, 1, ortho()),
}


def arguments_of(degree: int | None, view):
    scene = cloud(degree or 0)
    arguments = gsplat_arguments(scene, view, replace(view, cx=view.cx + 3))
    if degree is None:
        generator = torch.Generator().manual_seed(0)
        features = torch.randn(len(scene), 5, generator=generator, dtype=torch.float64)
        arguments |= {"colors": features, "sh_degree": None}
    arguments["scales"] = arguments["scales"].clone()
    arguments["scales"][::3] *= -1  # the covariance has the square
    return arguments


def drawn(arguments, options, kernel_name: str):
    leaves = {name: arguments[name].detach().clone().requires_grad_() for name in INPUTS}
    execution = Execution(kernel=kernel_name)
    color, alpha, meta = rasterization(**arguments | leaves, **options, execution=execution)
    shown = (meta["radii"] > 0).all(-1)
    loss = loss_of(color[0], alpha[0, ..., 0]) + loss_of(color[1], alpha[1, ..., 0])
    # of what is drawn: the front end may keep more in sight
    loss = loss + 1e-2 * meta["means2d"][shown].square().sum()
    loss.backward()
    meta = {"means2d": meta["means2d"][shown].detach(), "radii": meta["radii"]}
    grads = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    return color, alpha, meta, grads


@pytest.mark.parametrize("name", CASES)
def test_both_kernels_draw_the_same(name, monkeypatch):
    options, degree, view = CASES[name]
    arguments = arguments_of(degree, view)
    color, alpha, meta, grads = drawn(arguments, options, "torch")
    prepared = []
    original = picture.kernel.list_gaussians
    monkeypatch.setattr(
        picture.kernel, "list_gaussians", lambda *a: prepared.append(1) or original(*a)
    )
    found = drawn(arguments, options, "compiled")
    assert len(prepared) == 2
    assert (found[0] - color).abs().max() < 1e-10
    assert (found[1] - alpha).abs().max() < 1e-10
    assert torch.equal(found[2]["radii"], meta["radii"])
    assert relative(found[2]["means2d"], meta["means2d"]) < 1e-10
    assert found[3].keys() == grads.keys()
    for each, wanted in grads.items():
        assert relative(found[3][each], wanted) < 1e-8, each
