"""Moving a scene together with its camera does not change the picture."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from closeness import EPS32, assert_near

from gsedit.errors import UsageError
from gsedit.scene.similarity import moved_camera
from gsedit.scene.table import SPLAT_FIELDS, SplatTable
from gsedit.toolkit import transform
from gsedit.toolkit.transform import compose
from rasterizer import Camera, Gaussians, render

CAMERA = Camera(torch.eye(4, dtype=torch.float64), 90.0, 90.0, 30.0, 33.0, 64, 64)


def glossy(n: int = 80, degree: int = 4) -> SplatTable:
    """Splats in front of CAMERA whose color depends on the direction."""
    draw = np.random.default_rng(3)
    sh = 0.3 * draw.normal(size=(n, (degree + 1) ** 2, 3))
    sh[:, 0] += 1
    fields = [
        draw.normal(size=(n, 3)) * (1, 1, 0.5) + (0, 0, 5),
        draw.normal(size=(n, 4)),
        draw.uniform(-3, -0.7, (n, 3)),
        draw.uniform(-1, 3, n),
        sh,
    ]
    return SplatTable(*[field.astype(np.float32) for field in fields])  # pyright: ignore[reportArgumentType]


def picture(table: SplatTable, camera: Camera) -> torch.Tensor:
    """Picture of the float32 values, rendered in float64."""
    fields = (torch.from_numpy(getattr(table, name)).double() for name in SPLAT_FIELDS)
    return render(Gaussians(*fields), camera).color


@pytest.mark.parametrize(
    "steps",
    [
        {"rotate": (30.0, -50.0, 110.0)},
        {"mirror": "x"},
        {"mirror": "z"},
        {"scale": 3.7},
        {"rotate_axis": (1, 2, 3, 77.0), "scale": 0.2, "translate": (5, -3, 2), "mirror": "y"},
    ],
)
@pytest.mark.parametrize("degree", [1, 4])
def test_the_picture_stays_when_the_camera_moves_along(steps, degree):
    table = glossy(degree=degree)
    similarity = compose(steps.items())
    before = picture(table, CAMERA)
    moved = transform(table, **steps)
    assert not np.allclose(moved.means, table.means, atol=0.1)
    after = picture(moved, moved_camera(CAMERA, similarity))
    if similarity.mirrors:
        after = after.flip(1)
    assert before.amax() > 0.5
    # positions of the size of 10 are rounded, and shown at tens of pixels a unit
    assert_near(after, before, 500 * EPS32)


def test_a_part_is_moved_and_the_rest_stays():
    table = glossy().replace(extra={"label": np.arange(80)})
    left = table.means[:, 0] < 0
    moved = transform(table, selection="x < 0", translate=(0, 9, 0), mirror="x")
    for name in ("means", "quats", "sh"):
        np.testing.assert_array_equal(getattr(moved, name)[~left], getattr(table, name)[~left])
    np.testing.assert_allclose(
        moved.means[left], table.means[left] * [-1, 1, 1] + [0, 9, 0], rtol=1e-6
    )
    both = transform(table, selection="x < 0", translate=(0, 9, 0), copy=True)
    assert len(both) == 80 + left.sum()
    np.testing.assert_array_equal(both.extra["label"][80:], np.arange(80)[left])
    np.testing.assert_array_equal(both.means[:80], table.means)


def test_steps_are_done_in_the_order_given():
    table = glossy()
    first = transform(table, scale=2.0, translate=(1, 0, 0)).means
    second = transform(table, translate=(1, 0, 0), scale=2.0).means
    np.testing.assert_allclose(second - first, np.tile([1.0, 0, 0], (80, 1)), atol=1e-5)
    euler = compose([("rotate", (90.0, 0.0, 90.0))])
    np.testing.assert_allclose(euler.turn @ [0, 1, 0], [0, 0, 1], atol=1e-12)  # x first
    np.testing.assert_allclose(euler.turn @ [1, 0, 0], [0, 1, 0], atol=1e-12)  # then z


@pytest.mark.parametrize(
    "steps",
    [
        {"scale": -1.0},
        {"mirror": "w"},
        {"up": ("z",)},
        {"quat": (0, 0, 0, 0)},
        {"rotate": (1, 2)},
        {"matrix": np.diag([1, 2, 1, 1])},
        {"turn": 3},
    ],
)
def test_wrong_steps_are_named(steps):
    with pytest.raises(UsageError, match=next(iter(steps))):
        transform(glossy(3), **steps)
