"""Inputs that cannot be drawn are refused with their name, row and count."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import torch

from gsedit.bench.renderer.stability import CROWD, camera, gaussian, over_background, random_cloud
from rasterizer import Numerics, harmonics, render


def spoil(name: str, rows: list[int], value: float):
    scene = over_background(random_cloud(CROWD, seed=3, degree=1)).scene
    values = getattr(scene, name).clone()
    values.view(CROWD, -1)[rows, 1 if values.dim() > 1 else 0] = value
    return replace(scene, **{name: values})


def test_the_first_bad_row_is_named_and_all_are_counted():
    with pytest.raises(ValueError, match=re.escape(
        "quats[5, 1] is nan, the first of 3 bad rows of 200: leave them out, or find what made them"
    )):  # fmt: skip
        render(spoil("quats", [90, 5, 17], float("nan")), camera())


@pytest.mark.parametrize("name", ["means", "quats", "log_scales", "logit_opacities"])
def test_a_bad_row_out_of_sight_is_refused_too(name):
    scene = spoil(name, [40], float("nan"))
    scene.means[40, 2] = -3.0  # behind the camera
    with pytest.raises(ValueError, match=rf"{name}\[40"):
        render(scene, camera())


def test_finite_harmonics_whose_sum_overflows_are_refused():
    scene = gaussian((0.3, -0.2, 2.0)).to(torch.float32)
    weights = harmonics.basis(scene.means / scene.means.norm(), 3)
    scene = replace(scene, sh=3e38 * weights.sign()[..., None].expand(1, 16, 3))
    assert scene.sh.isfinite().all()
    with pytest.raises(ValueError, match=r"sh\[0, 0\] is inf"):
        render(scene, camera())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("fx", -40.0, "camera.fx is -40.0: focal lengths are above 0, in pixels"),
        ("fy", 0.0, "camera.fy is 0.0: focal lengths are above 0, in pixels"),
        ("width", 0, "the camera's picture is 0x32: it has no pixel"),
    ],
)
def test_a_camera_without_a_picture_is_refused(name, value, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        render(random_cloud(5, seed=3), replace(camera(), **{name: value}))


@pytest.mark.parametrize("name", ["near", "far", "blur", "alpha_min", "radius_clip"])
def test_a_setting_that_is_nan_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} is nan"):
        render(random_cloud(5, seed=3), camera(), numerics=Numerics(**{name: float("nan")}))


def test_a_center_in_the_cameras_plane_is_refused_where_near_is_zero():
    scene = gaussian((0.1, 0.0, 1e-310), (0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match=r"means\[0\] is too close to the camera"):
        render(scene, camera(), numerics=Numerics(near=0.0))
