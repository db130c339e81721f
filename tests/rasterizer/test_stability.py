"""Edge cases: finite pictures and gradients, or a ValueError that names the input and the row."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
import torch
from closeness import EPS32, leaves, relative, tensors, weights_like

from gsedit.bench.renderer import stability
from gsedit.bench.renderer.edge_cases import (
    CROWD,
    EDGE_CASES,
    camera,
    gaussian,
    over_background,
    random_cloud,
)
from rasterizer import Execution, Numerics, Rendering, checks, harmonics, rasterization, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.project import project, rotation_matrices

DTYPES = (torch.float32, torch.float64)
BY_NAME = {case.name: case for case in EDGE_CASES}
ROUNDING = CROWD * EPS32
"""Of a colour in [0, 1]: a rounding for each Gaussian that one pixel can blend."""
DRAWN = [case.name for case in EDGE_CASES if case.refused is None]

# What float32 cannot give, and why. Everything else keeps the promise of 2e-4.
GRADIENTS_32 = {
    # z moves its centre by 1e7 pixels and its width by as much: what is left is 1e-6 of both
    "scale 1e6 far aside": 1e6 * EPS32,
    # the one pixel is 0.1 from each centre: the gradient of the shape, 0.01 pixel^2, is a
    # difference of terms of the tile's corner, 12 pixel^2
    "100,000 layers": 1e-2,
    # the largest float is less than the gradient of the row, which is 0 instead
    "denormal quaternion": 1.001,
}
# Where float64 and its reference differ by more than a few roundings, and why.
ERRORS_64 = {
    # the reference's determinant is a difference of 1e13 and 1e13 pixels^4
    "needle 1e3 : 1e-3": 1e-6,
    "needle of 1000 pixels": 1e-10,
    # eps * 1e7 is 2e-9 of a standard deviation
    "1e7 from the origin": 1e-8,
}


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", BY_NAME)
def test_every_edge_case_is_right_or_refused_by_name(name, dtype):
    case = BY_NAME[name]
    row = stability.measure_edge_case(case, dtype, runs=1)
    if case.refused is not None:
        assert row.outcome == "refused"
        assert re.match(case.refused, row.message)
        return
    assert row.outcome == "finite"
    if dtype == torch.float32:
        assert row.image_error < 2e-5
        assert row.gradient_error < GRADIENTS_32.get(name, 2e-4)
    else:
        assert row.image_error < ERRORS_64.get(name, 1e-12)
        assert row.gradient_error < ERRORS_64.get(name, 1e-9)


Drawn = tuple[Rendering, tuple[torch.Tensor, ...]]


def draw(name: str, dtype: torch.dtype, numerics: Numerics, compile: bool = False) -> Drawn:
    """All that a picture has, and the gradients of a loss of all of it, by every input."""
    scene, view, background = BY_NAME[name].make(dtype)
    inputs, pose = leaves(scene), view.world_to_camera.clone().requires_grad_()
    picture = render(
        inputs,
        replace(view, world_to_camera=pose),
        background=background.requires_grad_(),
        depth=True,
        median_depth=True,
        numerics=numerics,
        execution=Execution(compile=compile),
    )
    loss = sum((part * weights_like(part)).sum() for part in visible_parts(picture))
    return picture, torch.autograd.grad(loss, (*tensors(inputs), pose, background))


def visible_parts(picture: Rendering) -> tuple[torch.Tensor, ...]:
    return picture.color, picture.alpha, picture.depth


@cache
def draw_all(name: str, dtype: torch.dtype) -> Drawn:
    return draw(name, dtype, stability.WITHOUT_STOP)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", DRAWN)
def test_depths_alphas_and_their_gradients_are_finite(name, dtype):
    drawn = [draw_all(name, dtype)]
    if name != "100,000 layers":  # takes seconds
        drawn.append(draw(name, dtype, Numerics()))
    for picture, gradients in drawn:
        parts = (*visible_parts(picture), picture.median_depth, *gradients)
        assert all(part.isfinite().all() for part in parts)
        assert ((picture.alpha >= 0) & (picture.alpha <= 1)).all()


@pytest.mark.skipif(compiled.load() is None, reason="no C++ compiler compiles the kernel here")
@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("name", DRAWN)
def test_the_compiled_kernel_draws_every_edge_case_like_torch(name, dtype):
    wanted, truths = draw_all(name, dtype)
    found, gradients = draw(name, dtype, stability.WITHOUT_STOP, compile=True)
    # each is within its bar of the reference, so within twice that of each other
    picture_bar, gradient_bar = (4e-5, 4e-4) if dtype == torch.float32 else (1e-11, 1e-9)
    brightest = max(1.0, float(wanted.color.detach().max()))
    assert (found.color - wanted.color).abs().max() < picture_bar * brightest
    assert (found.alpha - wanted.alpha).abs().max() < picture_bar
    if dtype == torch.float32:
        gradient_bar = 2 * GRADIENTS_32.get(name, gradient_bar / 2)
    for a, b in zip(gradients, truths):
        assert a.isfinite().all()
        # what passes 100,000 layers is 0, or denormal
        assert relative(a, b) < gradient_bar or b.norm() < 1e-30


@pytest.mark.parametrize(
    "name", ["needle 1e3 : 1e-3", "needle of 1000 pixels", "1e7 from the origin"]
)
def test_the_textbook_is_a_hundred_times_as_wrong(name):
    row = stability.measure_edge_case(BY_NAME[name], torch.float32, runs=1)
    assert row.textbook_image_error > 100 * row.image_error


HIDDEN = {
    "behind the camera", "in the camera's plane", "at the near plane", "1e-6 before the near plane",
    "opacity 0", "logit -50",
}  # fmt: skip


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_extreme_rows_are_drawn_unless_they_are_hidden(dtype):
    hidden = set()
    for name in DRAWN:
        scene, view, background = BY_NAME[name].make(dtype)
        if len(scene) != CROWD + 1:  # not one among many
            continue
        rest = scene[torch.arange(CROWD + 1) != CROWD // 2]
        with_it, without = (render(s, view, background=background).color for s in (scene, rest))
        # another number of Gaussians is a product of another shape: it may round otherwise
        difference = (with_it - without).abs().max()
        if difference <= ROUNDING:
            hidden.add(name)
        else:  # it shows: more than rounding would
            assert difference > 1e-2
    assert hidden == HIDDEN


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_nothing_visible_has_zero_gradients(dtype):
    scene, view, background = BY_NAME["nothing visible"].make(dtype)
    inputs = leaves(scene)
    picture = render(inputs, view, background=background)
    assert (picture.color == background).all()
    gradients = torch.autograd.grad(picture.color.sum(), tensors(inputs))
    assert all((gradient == 0).all() for gradient in gradients)


def test_scales_are_drawn_up_to_a_limit_and_refused_beyond_it():
    """1e-38 to 1e38 in float32: the limit is one, and above what any scene holds."""
    refusals: list[str] = []
    for exponent in range(-38, 39, 2):
        scene = gaussian((0.1, 0.0, 2.0), (10.0**exponent,) * 3).to(torch.float32)
        inputs = leaves(scene)
        try:
            picture = render(inputs, camera()).color
        except ValueError as error:
            refusals.append(str(error))
            continue
        assert not refusals  # what is refused stays refused
        gradients = torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))
        assert all(part.isfinite().all() for part in (picture, *gradients))
        if exponent >= 6:  # covers the picture evenly: its opacity times its colour
            assert (picture - 0.7 * picture.new_tensor((0.8, 0.4, 0.2))).abs().max() < 1e-5
        largest = exponent
    assert largest >= 16
    assert refusals
    assert all(text.startswith("log_scales[0] is out of range: its varia") for text in refusals)


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


def test_harmonics_out_of_sight_are_not_looked_at():
    scene = spoil("sh", [40], float("nan"))
    scene.means[40, 2] = -3.0
    inputs = leaves(scene)
    picture = render(inputs, camera()).color
    gradients = torch.autograd.grad(picture.sum(), tensors(inputs))
    assert all(part.isfinite().all() for part in (picture, *gradients))


def test_finite_harmonics_whose_sum_overflows_are_refused():
    scene = gaussian((0.3, -0.2, 2.0)).to(torch.float32)
    weights = harmonics.basis(scene.means / scene.means.norm(), 3)
    scene = replace(scene, sh=3e38 * weights.sign()[..., None].expand(1, 16, 3))
    assert scene.sh.isfinite().all()
    with pytest.raises(ValueError, match=r"sh\[0, 0\] is inf"):
        render(scene, camera())


def test_finite_numbers_whose_sum_overflows_are_drawn():
    scene = random_cloud(50, seed=3).to(torch.float32)
    scene.means[:4, 0] = 3e38  # far off the picture, and not the checks' business
    assert render(scene, camera()).color.isfinite().all()


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


def test_fields_of_different_lengths_are_refused():
    scene = random_cloud(5, seed=3)
    # the types of these tests would refuse it sooner
    object.__setattr__(scene, "quats", scene.quats[:4])
    with pytest.raises(ValueError, match=r"quats has 4 rows, means has 5: one a Gaussian"):
        checks.scene(scene)


def test_a_centre_in_the_cameras_plane_is_refused_where_near_is_zero():
    scene = gaussian((0.1, 0.0, 1e-310), (0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match=r"means\[0\] is too close to the camera"):
        render(scene, camera(), numerics=Numerics(near=0.0))


# Rotations


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
    scene, view, _ = BY_NAME["1e7 from the origin"].make(torch.float32)
    found = project(scene, view, Numerics()).xy
    wanted = project(scene.to(torch.float64), view, Numerics()).xy
    seen = wanted.abs().amax(1) < 100
    assert seen.sum() > 50
    assert (found - wanted)[seen].abs().max() < 1e-5  # float32 of a pixel's position, once


# Nobody else's torch is changed


def flags() -> dict[str, object]:
    tiny = torch.tensor([1e-40]) * 0.5  # 0 where denormals are flushed
    return {
        "default dtype": torch.get_default_dtype(),
        "default device": torch.get_default_device(),
        "gradients": torch.is_grad_enabled(),
        "inference": torch.is_inference_mode_enabled(),
        "anomalies": torch.is_anomaly_enabled(),
        "threads": (torch.get_num_threads(), torch.get_num_interop_threads()),
        "denormals": bool(tiny > 0),
        "deterministic": (
            torch.are_deterministic_algorithms_enabled(),
            torch.is_deterministic_algorithms_warn_only_enabled(),
            torch.backends.cudnn.deterministic,
        ),
        "matmul": torch.get_float32_matmul_precision(),
        "mkldnn": torch.backends.mkldnn.enabled,
        "torch draws": torch.get_rng_state().tolist(),
        "numpy draws": [np.asarray(part).tolist() for part in np.random.get_state()],
        "numpy errors": np.geterr(),
    }


def differentiated(name: str = "ordinary crowd"):
    scene, view, background = BY_NAME[name].make(torch.float32)
    inputs = leaves(scene)
    picture = render(inputs, view, background=background, depth=True, median_depth=True)
    loss = (picture.color * weights_like(picture.color)).sum() + picture.depth.sum()
    return picture.color.detach(), torch.autograd.grad(loss, tensors(inputs))


@pytest.mark.parametrize("name", ["ordinary crowd", "empty scene", "nothing visible", "means nan"])
def test_no_global_flag_is_changed(name):
    before = flags()
    if BY_NAME[name].refused is None:
        differentiated(name)
    else:
        with pytest.raises(ValueError, match=r"means\[57, 2\]"):
            differentiated(name)
    assert flags() == before


def test_global_flags_of_others_change_nothing():
    picture, gradients = differentiated()
    torch.set_default_dtype(torch.float64)
    torch.use_deterministic_algorithms(True)
    try:
        again, others = differentiated()
    finally:
        torch.use_deterministic_algorithms(False)
        torch.set_default_dtype(torch.float32)
    assert again.dtype == torch.float32
    assert torch.equal(again, picture)
    assert all(torch.equal(a, b) for a, b in zip(others, gradients))


@pytest.mark.parametrize("context", [torch.no_grad, torch.inference_mode])
def test_a_picture_without_gradients_is_the_same(context):
    """To rounding: without a depth channel the products have another shape."""
    picture, _ = differentiated()
    scene, view, background = BY_NAME["ordinary crowd"].make(torch.float32)
    with context():
        plain = render(scene, view, background=background).color
    torch.testing.assert_close(plain, picture, rtol=0, atol=ROUNDING)


# The drop-in refuses the same, under its own names


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
    scene.means[7] = torch.tensor((0.0, 0.0, 2.0))  # colours are looked at where they are in sight
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


# The table


def test_rows_are_both_dtypes_of_each_edge_case_or_float32_alone():
    full = list(islice(stability.measurements(), 4))
    assert [row.name for row in full] == [EDGE_CASES[i // 2].name for i in range(4)]
    assert [row.dtype for row in full] == ["float32", "float64"] * 2
    quick = list(islice(stability.measurements(quick=True), 2))
    assert [row.dtype for row in quick] == ["float32", "float32"]
    assert all(row.seconds > 0 for row in (*full, *quick))


def test_the_table_shows_errors_refusals_and_what_is_not_finite():
    names = ("ordinary crowd", "needle 1e3 : 1e-3", "means nan")
    found = [
        stability.measure_edge_case(BY_NAME[name], dtype, 1) for name in names for dtype in DTYPES
    ]
    text = stability.table(found)
    assert text.count("\n| **") == 2
    assert f"| {found[0].image_error:.1e} | {found[0].textbook_image_error:.1e} |" in text
    assert "means[57, 2] is nan" in text
    broken = replace(found[0], outcome="not finite", image_error=None, gradient_error=None)
    assert stability.table([broken]).count("**not finite**") == 2
    for row in (*found, broken):
        assert json.loads(json.dumps(asdict(row), allow_nan=False))["name"] == row.name
