"""Completing a picture: periods go on, light is even, labels are no worse than a single one."""

from __future__ import annotations

import numpy as np
import pytest

from gsedit.change.objects.removal.complete import complete
from gsedit.change.objects.removal.fill import around
from gsedit.change.objects.removal.sheet import find_shade

ROWS, COLUMNS = np.mgrid[:64, :64]
HOLE = (ROWS - 33) ** 2 / 15**2 + (COLUMNS - 30) ** 2 / 12**2 < 1


def pattern(name: str) -> np.ndarray:
    """A texture of 64 by 64 pixels."""
    even = {
        "checker": (ROWS // 8 + COLUMNS // 8) % 2,
        "bricks": ((ROWS % 9) < 2) | (((COLUMNS + (ROWS // 9 % 2) * 7) % 14) < 2),
        "stripes": (COLUMNS // 5) % 2,
    }[name]
    return (0.3 + 0.4 * even[..., None]) * np.array((1.0, 0.8, 0.6))


@pytest.mark.parametrize(
    ("name", "fading", "leaves"),
    [("checker", 0.3, 0), ("stripes", 0, 0), ("checker", 0.3, 3), ("stripes", 0.3, 3)],
)
def test_a_pattern_goes_on_in_fading_light_and_leaves_beside_it_do_not(name, fading, leaves):
    picture = pattern(name) * (1 - fading + fading * COLUMNS / 64)[..., None]
    places = [(33 + 15 * np.sin(a), 30 + 12 * np.cos(a)) for a in (0.3, 1.9, 3.5, 5.0)]
    litter = np.any([np.hypot(ROWS - y, COLUMNS - x) < leaves for y, x in places], 0)
    seen = np.where(litter[..., None], (0.6, 0.1, 0.1), picture)
    done = complete(np.where(HOLE[..., None], 0.0, seen), ~HOLE, HOLE)
    assert done.textured
    assert np.abs(done.picture - picture)[HOLE].mean() < 0.01


def test_known_pixels_keep_their_bits_and_the_rest_is_not_touched():
    picture, known = pattern("bricks"), ~HOLE & (COLUMNS < 55)
    other = picture.copy()
    other[COLUMNS >= 55] = np.nan
    done = complete(other, known, HOLE)
    assert np.array_equal(done.picture[~HOLE], other[~HOLE], equal_nan=True)
    assert np.isfinite(done.picture[HOLE]).all()


def test_a_shadow_is_found_and_paint_is_not():
    away = np.hypot(ROWS - 32, COLUMNS - 32)
    caster, everywhere = away < 5, np.ones((64, 64), bool)
    light = 1 - 0.5 * np.clip(1 - away / 18, 0, 1)
    picture = pattern("checker") * light[..., None]
    shade, _ = find_shade(picture, everywhere, ~everywhere, caster, ~everywhere, 40.0)
    near = (away > 6) & (away < 14)
    left = picture / shade - pattern("checker")
    assert np.abs(left)[near].mean() < 0.5 * np.abs(picture - pattern("checker"))[near].mean()
    rug = np.where((away < 14)[..., None], (0.6, 0.1, 0.1), pattern("stripes"))
    shade, _ = find_shade(rug, everywhere, ~everywhere, caster, ~everywhere, 40.0)
    assert (shade == 1).all()


def test_a_shadow_is_found_though_soil_across_the_object_is_dark():
    hole = abs(COLUMNS - 32) < 4
    fading = 1 - 0.3 * np.clip(1 - (COLUMNS - 36) / 14, 0, 1)
    light = np.where(COLUMNS > 32, fading, np.where(COLUMNS > 8, 0.84, 1.0))
    picture = np.repeat(0.6 * light[..., None], 3, 2)
    shade, _ = find_shade(picture, ~hole, hole, hole, np.zeros_like(hole), 40.0)
    assert shade[:, 37:40].mean() < 0.9
    assert (shade[:, :28] == 1).all()


def test_a_hole_is_filled_from_what_is_near_it():
    hole = np.hypot(ROWS - 8, COLUMNS - 8) < 4
    near = around(~hole, hole)
    assert near[8, 16]
    assert not near[:, 30:].any()
    assert not (near & hole).any()
