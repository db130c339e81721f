"""Joining scenes, sorting their rows, and leaving fewer Gaussians with the same look."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_scenes import globe

from gsedit import orbit
from gsedit.bench.synthetic import surface_gaussians
from gsedit.errors import InputError
from gsedit.scene.neighbors import morton_codes
from gsedit.scene.table import SplatTable, concatenate_tables, gaussians_of, table_of
from gsedit.toolkit import Decimate, Order, apply, merge
from gsedit.toolkit.decimate import groups, log_determinant, moments_of, picture_change, represent


def decimate(table: SplatTable, count: int | None = None, **words) -> SplatTable:
    return apply(table, Decimate(count, **words))


def haze(n: int = 300, degree: int = 1) -> SplatTable:
    """Faint splats: joined, they are nowhere as opaque as can be."""
    draw = np.random.default_rng(1)
    fields = [
        draw.normal(size=(n, 3)),
        draw.normal(size=(n, 4)),
        draw.uniform(-3, -2, (n, 3)),
        draw.uniform(-5, -4, n),
        draw.normal(size=(n, (degree + 1) ** 2, 3)),
    ]
    extra = {"label": np.arange(n)}
    return SplatTable(*[field.astype(np.float32) for field in fields], extra=extra)  # pyright: ignore[reportArgumentType]


def surface(count: int = 1500) -> SplatTable:
    scene = globe()
    return table_of(surface_gaussians(scene, count, torch.Generator().manual_seed(0)))


def test_merge_keeps_rows_degrees_and_columns():
    a, b = haze(5, degree=0), haze(7, degree=2)
    b = b.replace(extra={"weight": np.ones(7, np.float32)})
    notes: list[str] = []
    whole = merge(a, b)
    np.testing.assert_array_equal(whole.means, np.concatenate([a.means, b.means]))
    assert whole.degree == 2
    assert not whole.sh[:5, 1:].any()
    np.testing.assert_array_equal(whole.sh[5:], b.sh)
    np.testing.assert_array_equal(whole.extra["label"], [*range(5), *([0] * 7)])
    assert np.isnan(whole.extra["weight"][:5]).all()
    from gsedit.toolkit import Merge
    from gsedit.toolkit.merge import _source

    apply(a, Merge((_source(0, b),)), say=notes.append)
    assert any("degree 0 became degree 2" in note for note in notes)
    assert sum("lacks columns" in note for note in notes) == 2


def test_mortons_order_keeps_near_rows_together():
    table = haze(3000)
    steps = np.linalg.norm(np.diff(table.means, axis=0), axis=1).mean()
    ordered = apply(table, Order())
    assert np.linalg.norm(np.diff(ordered.means, axis=0), axis=1).mean() < 0.2 * steps
    np.testing.assert_array_equal(np.sort(ordered.extra["label"]), np.arange(3000))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], np.float32)
    assert morton_codes(corners).argsort().tolist() == [0, 1, 2, 3, 4]
    assert morton_codes(np.array([[np.nan, 0, 0], [0, 0, 0]], np.float32)).argmax() == 0


def test_joined_splats_keep_mass_mean_covariance_and_color():
    table = haze()
    few = decimate(table, 40)
    assert len(few) == 40
    before, after = moments_of(table), moments_of(few)
    assert after.mass.sum() == pytest.approx(before.mass.sum(), rel=1e-4)

    def whole(m):
        weight = m.mass / m.mass.sum()
        mean = weight @ m.mean
        apart = m.mean - mean
        second = m.covariance + apart[:, :, None] * apart[:, None]
        return mean, np.einsum("n,nij->ij", weight, second), weight

    (mean, covariance, w), (other_mean, other_covariance, v) = whole(before), whole(after)
    np.testing.assert_allclose(other_mean, mean, atol=1e-5)
    np.testing.assert_allclose(other_covariance, covariance, atol=1e-5)
    np.testing.assert_allclose(
        np.einsum("n,nkc->kc", v, few.sh), np.einsum("n,nkc->kc", w, table.sh), atol=1e-5
    )


def test_a_group_of_one_stays_and_twins_become_one():
    table = haze(20)
    np.testing.assert_array_equal(represent(table, np.arange(20)).quats, table.quats)
    twins = concatenate_tables([table, table])
    few = represent(twins, groups(twins, 20))
    at = few.extra["label"].argsort()
    assert few.extra["label"][at].tolist() == list(range(20))
    np.testing.assert_allclose(few.means[at], table.means, atol=1e-6)
    np.testing.assert_allclose(
        log_determinant(moments_of(few[at]).covariance),
        log_determinant(moments_of(table).covariance),
        atol=1e-3,
    )
    np.testing.assert_allclose(few.opacities[at], 2 * table.opacities, rtol=1e-3)


def test_joining_looks_better_than_leaving_out():
    table = surface(1000)
    views = orbit(gaussians_of(table), 2, 128)
    left = {
        method: picture_change(table, decimate(table, share=0.4, method=method), views)
        for method in ("merge", "importance", "random")
    }
    assert left["merge"] > max(left["importance"], left["random"]) + 3
    assert picture_change(table, table, views) == np.inf


def test_invalid_rows_are_not_joined():
    table = haze(20)
    table.means[3, 1] = np.nan
    with pytest.raises(InputError, match=r"row 3 \(from 0\): column y is nan"):
        decimate(table, 10)
