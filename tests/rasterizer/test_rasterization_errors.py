"""`rasterization` refuses by name what it cannot do and what cannot be drawn."""

from inspect import unwrap

import pytest
import torch
from gsplat_call import BACKGROUND, cloud, gsplat_arguments
from scenes import camera

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


def test_a_near_plane_behind_a_pinhole_is_refused():
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        rasterization(**gsplat_arguments(cloud(), camera()), near_plane=-1.0)
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        render(cloud(), camera(), numerics=Numerics(near=-1.0))
