"""The paint route on an exact subject: a lit ball on the ground."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsedit.editing.routes.apply import apply_change
from gsedit.editing.routes.paint import BLACKEST, FINISHES, painted
from gsedit.errors import UsageError
from gsedit.measures.color_difference import ciede2000
from gsedit.regions.region import Region
from gsedit.scene.color_space import LUMINANCE, lab_of_srgb, linear_of_srgb, srgb_of_linear
from gsedit.scene.quaternions import even_directions
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.words.instruction import Change
from rasterizer.numerics import SH_DC

BALL, GROUND = 3000, 500
SUN = np.array([0.6, -0.64, 0.48])
ASKED = ("#653700", "#029386", "#e50000", "#ffffff", "#000000", "#0343df", "#808080", "#fac205")


def colored(albedo: np.ndarray) -> SplatTable:
    """A ball of that albedo (display colors) under sun and sky, on gray ground."""
    normals = even_directions(BALL)
    light = 0.3 + 0.7 * np.maximum(normals @ SUN, 0)
    ball = srgb_of_linear(linear_of_srgb(np.broadcast_to(albedo, (BALL, 3))) * light[:, None])
    rng = np.random.default_rng(0)
    ground = np.stack((*rng.uniform(-3, 3, (2, GROUND)), np.full(GROUND, 1.0)), 1)
    n = BALL + GROUND
    sh = np.zeros((n, 4, 3), np.float32)
    sh[:, 0] = (np.concatenate((ball, np.full((GROUND, 3), 0.7))) - 0.5) / SH_DC
    sh[:, 1:] = rng.normal(0, 0.02, (n, 3, 3))
    return SplatTable(
        np.concatenate((normals, ground)).astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.full((n, 3), -3, np.float32),
        np.full(n, 4, np.float32),
        sh,
    )


def ball() -> np.ndarray:
    return np.arange(BALL + GROUND) < BALL


def rgb(text: str) -> np.ndarray:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def mean_color(table: SplatTable) -> np.ndarray:
    return np.clip(table.colors[:BALL].astype(np.float64), 0, 1).mean(0)


def distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(ciede2000(lab_of_srgb(one[None]), lab_of_srgb(other[None]))[0])


def test_the_mean_is_the_color_asked_for():
    before = colored(np.array([0.55, 0.5, 0.45]))
    found = [
        distance(mean_color(painted(before, ball(), rgb(color))), rgb(color)) for color in ASKED
    ]
    assert np.median(found) < 5
    assert max(found) < 15


@pytest.mark.parametrize("color", ["#029386", "#653700"])
def test_the_light_stays(color):
    before = colored(np.array([0.55, 0.5, 0.45]))
    after = painted(before, ball(), rgb(color))
    light, now = (
        linear_of_srgb(t.colors[:BALL].astype(float)) @ LUMINANCE for t in (before, after)
    )
    assert np.corrcoef(light, now)[0, 1] > 0.98
    hue = after.colors[:BALL] / np.maximum(after.colors[:BALL].max(1, keepdims=True), 1e-3)
    assert np.ptp(hue, axis=0).max() < 0.15


def test_a_gray_subject_painted_in_its_own_gray_hardly_changes():
    before = colored(np.full(3, 0.6))
    after = painted(before, ball(), mean_color(before))
    assert np.abs(after.colors - before.colors)[:BALL].mean() < 0.02


def test_fine_painted_texture_goes():
    rng = np.random.default_rng(1)
    spots = np.where(rng.random((BALL, 1)) < 0.3, [[0.9, 0.2, 0.2]], [[0.5, 0.5, 0.5]])
    before = colored(spots)
    after = painted(before, ball(), rgb("#029386"))
    smooth = painted(colored(np.full(3, 0.5)), ball(), rgb("#029386"))
    error = np.abs(after.colors - smooth.colors)[:BALL].mean()
    assert error < 0.5 * np.abs(before.colors - colored(np.full(3, 0.5)).colors)[:BALL].mean()


def test_outside_the_bits_are_the_same():
    before = colored(np.full(3, 0.5))
    after = painted(before, ball(), rgb("#e50000"))
    assert np.array_equal(after.sh[BALL:], before.sh[BALL:])
    assert not np.array_equal(after.sh[:BALL], before.sh[:BALL])


def test_a_finish_decides_what_depends_on_the_direction():
    before = colored(np.full(3, 0.5))
    shine = {
        name: np.abs(painted(before, ball(), rgb("#029386"), finish).sh[:BALL, 1:]).sum()
        for name, finish in FINISHES.items()
    }
    assert shine["matte"] == 0
    assert min(shine["glossy"], shine["metallic"]) > 0


def test_black_paint_is_no_hole():
    after = painted(colored(np.full(3, 0.5)), ball(), rgb("#000000"))
    assert 0 < linear_of_srgb(mean_color(after).astype(float)).max() < 3 * BLACKEST


def test_what_is_not_seen_does_not_decide():
    before = colored(np.full(3, 0.5))
    seen = np.ones(len(before), np.float32)
    seen[: BALL // 2] = 0
    after = painted(before, ball(), rgb("#029386"), seen=seen)
    visible = np.clip(after.colors[BALL // 2 : BALL], 0, 1).mean(0)
    assert distance(visible, rgb("#029386")) < 5


def test_a_region_of_nothing_and_a_color_that_is_none_are_refused():
    scene = gaussians_of(colored(np.full(3, 0.5)))
    nothing = Region(torch.zeros(len(scene), dtype=torch.bool))
    change = Change("subject", "paint", "teal", "#029386", None, "paint")
    with pytest.raises(UsageError, match="--region"):
        apply_change(scene, change, nothing)
    unnamed = Change("subject", "paint", "teal", None, None, "paint")
    with pytest.raises(UsageError, match="#008080"):
        apply_change(scene, unnamed, Region(torch.from_numpy(ball())))
