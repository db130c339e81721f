"""`rasterization` refuses by name what it cannot do and what cannot be drawn."""

from __future__ import annotations

from inspect import unwrap

import pytest
import torch
from gsplat_call import BACKGROUND, cloud, gsplat_arguments
from scenes import camera, random_cloud

from rasterizer import Numerics, rasterization, render


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("sparse_grad", True),
        ("absgrad", True),
        ("distributed", True),
        ("camera_model", "fisheye"),
        ("camera_model", "ftheta"),
        ("with_ut", True),
        ("with_eval3d", True),
        ("radial_coeffs", torch.zeros(1, 6)),
        ("tangential_coeffs", torch.zeros(1, 2)),
        ("thin_prism_coeffs", torch.zeros(1, 4)),
        ("ftheta_coeffs", object()),
        ("rolling_shutter", "ROLLING_TOP_TO_BOTTOM"),
        ("viewmats_rs", torch.eye(4)[None]),
        ("covars", torch.eye(3).expand(60, 3, 3)),
    ],
)
def test_what_is_not_here_says_so(option, value):
    with pytest.raises(NotImplementedError, match=option):
        rasterization(**gsplat_arguments(cloud(), camera()), **{option: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("quats", torch.zeros(60, 3)),
        ("scales", torch.zeros(59, 3)),
        ("opacities", torch.zeros(60, 1)),
        ("colors", torch.zeros(60, 3)),
        ("colors", torch.zeros(60, 4, 3)),
        ("colors", torch.zeros(3, 60, 9, 3)),
        ("viewmats", torch.zeros(2, 4, 4)),
        ("viewmats", torch.zeros(0, 4, 4)),
        ("Ks", torch.zeros(1, 4, 4)),
        ("backgrounds", torch.zeros(1, 4)),
        ("render_mode", "RGBD"),
        ("rasterize_mode", "smooth"),
    ],
)
def test_shapes_that_do_not_fit_are_named(name, value):
    unchecked = unwrap(rasterization)  # without jaxtyping, as users have it
    named = "Ks" if name == "viewmats" and len(value) == 2 else name  # two poses, one intrinsic
    with pytest.raises(ValueError, match=named):
        unchecked(**gsplat_arguments(cloud(), camera()) | {name: value})


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["means", "quats", "scales", "opacities", "colors", "viewmats",
                                  "Ks", "backgrounds"])  # fmt: skip
def test_what_is_not_finite_is_named(name, bad):
    arguments = gsplat_arguments(cloud(), camera()) | {"backgrounds": BACKGROUND[None]}
    spoilt = arguments[name].clone()
    spoilt.view(-1)[-1] = bad  # of the last row, which is in sight
    with pytest.raises(ValueError, match=name):
        rasterization(**arguments | {name: spoilt})


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [
        ("means", (7, 1), float("nan")),
        ("quats", (7, 1), float("inf")),
        ("scales", (7, 1), float("nan")),
        ("opacities", (7,), float("nan")),
        ("colors", (7, 1), float("nan")),
        ("viewmats", (0, 1, 3), float("nan")),
        ("Ks", (0, 0, 0), float("nan")),
        ("backgrounds", (0, 1), float("inf")),
    ],
)
def test_the_drop_in_names_its_own_arguments(name, index, value):
    scene = random_cloud(20, seed=3).to(torch.float32)
    scene.means[7] = torch.tensor((0.0, 0.0, 2.0))  # colors are looked at where they are in sight
    arguments = {
        "means": scene.means,
        "quats": scene.quats,
        "scales": scene.scales,
        "opacities": scene.opacities,
        "colors": scene.sh[:, 0].clone(),
        "viewmats": torch.eye(4)[None].clone(),
        "Ks": torch.tensor([[[40.0, 0.0, 20.0], [0.0, 40.0, 16.0], [0.0, 0.0, 1.0]]]),
        "backgrounds": torch.ones(1, 3),
    }
    arguments[name][index] = value
    with pytest.raises(ValueError, match=rf"{name}\["):
        rasterization(**arguments, width=40, height=32)


def test_a_near_plane_behind_a_pinhole_is_refused():
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        rasterization(**gsplat_arguments(cloud(), camera()), near_plane=-1.0)
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        render(cloud(), camera(), numerics=Numerics(near=-1.0))
