"""Grading: exact where it is affine, in order, on a selection; curves; opacities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from gsedit.errors import UsageError
from gsedit.formats.streams import SceneHeader, gather, in_blocks
from gsedit.scene.quaternions import even_directions, harmonics
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit import Opacity, Recolor, Selection, apply, recolor
from gsedit.toolkit.grade import Grade, curved, mapped, parse_curve, white
from gsedit.toolkit.operation import run
from rasterizer import look_at, render

GRADES = {
    "exposure": Grade(exposure=-1.5),
    "temperature": Grade(temperature=3200.0),
    "tint": Grade(tint=0.7),
    "contrast": Grade(contrast=1.3),
    "saturation": Grade(saturation=0.4),
    "hue": Grade(hue=75.0),
    "all": Grade(9000.0, -0.3, 0.2, 0.9, 1.2, -20.0),
}


def shiny_table(n: int = 40, degree: int = 4, gloss: float = 0.05) -> SplatTable:
    """Gaussians near the origin, of colors that stay above 0 from every direction."""
    draw = np.random.default_rng(1)
    sh = gloss * draw.normal(size=(n, (degree + 1) ** 2, 3))
    sh[:, 0] = draw.uniform(-0.3, 0.3, size=(n, 3))
    fields = (
        draw.uniform(-1, 1, (n, 3)), draw.normal(size=(n, 4)), draw.uniform(-2.5, -1, (n, 3)),
        draw.normal(size=n), sh,
    )  # fmt: skip
    return SplatTable(*(np.asarray(each, np.float32) for each in fields))


def colors_from(table: SplatTable, directions: np.ndarray) -> np.ndarray:
    """Colors of every Gaussian from every direction."""
    values = harmonics(directions, table.degree)
    return 0.5 + np.einsum("dk,nkc->ndc", values, table.sh.astype(np.float64))


LEFT = Selection(lambda table: table.means[:, 0] < 0)


@pytest.mark.parametrize("name", GRADES)
def test_an_affine_grade_acts_on_pictures_exactly_as_on_colors(name):
    grade, table = GRADES[name], shiny_table()
    camera = look_at(
        torch.tensor([2.0, -1.0, -3.0]), torch.zeros(3), torch.tensor([0.0, -1.0, 0.0]), 1.0, 48, 40
    )
    before = render(gaussians_of(table), camera)
    after = render(gaussians_of(replace(table, sh=mapped(table.sh, grade.affine))), camera)
    matrix, offset = grade.affine.matrix, grade.affine.offset
    expected = before.color.double().numpy() @ matrix.T + before.alpha[..., None].numpy() * offset
    np.testing.assert_allclose(after.color.numpy(), expected, atol=2e-5)


def test_white_is_that_of_the_standard_illuminants():
    x, y = 0.44757, 0.40745  # illuminant A, 2856 K (CIE 15)
    expected = np.array([x / y, 1, (1 - x - y) / y])
    from gsedit.scene.color_space import XYZ_OF_RGB

    np.testing.assert_allclose(XYZ_OF_RGB @ white(2856.0), expected, atol=6e-3)


def test_a_curve_is_monotone_and_meets_its_points():
    points = parse_curve("0.2:0.4,0.5:0.55,0.9:0.9")
    ramp = np.repeat(np.linspace(0, 1, 201)[:, None], 3, 1)
    after = curved(ramp, points)
    assert (np.diff(after[:, 0]) >= 0).all()
    np.testing.assert_allclose(after[[0, 40, 100, 180, 200], 0], [0, 0.4, 0.55, 0.9, 1], atol=1e-9)
    outside = curved(np.array([[-0.2, 1.3, 0.5]]), ((0.0, 0.1), (1.0, 0.8)))
    np.testing.assert_allclose(outside, [[-0.1, 1.1, 0.45]], atol=1e-9)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_a_curve_holds_from_every_direction(degree):
    table, points = shiny_table(degree=degree), ((0.25, 0.45), (0.75, 0.85))
    directions = even_directions(200)
    expected = curved(colors_from(table, directions).reshape(-1, 3), points)
    after = recolor(table, curve=points)
    error = colors_from(after, directions).reshape(-1, 3) - expected
    at_center = replace(table, sh=table.sh.copy())
    at_center.sh[:, 0] = (curved(table.colors.astype(np.float64), points) - 0.5) / 0.28209479
    plain = colors_from(at_center, directions).reshape(-1, 3) - expected
    assert np.sqrt(np.mean(error**2)) < (1e-6 if degree == 0 else 0.25 * np.sqrt(np.mean(plain**2)))


def test_only_the_selection_changes_and_parts_give_the_whole():
    table = shiny_table()
    inside = LEFT.mask(table)
    after = recolor(table, exposure=1.0, curve=((0.5, 0.6),), where=LEFT)
    np.testing.assert_array_equal(after.sh[~inside], table.sh[~inside])
    assert (np.abs(after.sh[inside, 0] - table.sh[inside, 0]) > 0).any(1).all()
    step = Recolor(Grade(exposure=1.0, curve=((0.5, 0.6),)), selection=LEFT)
    header, blocks, _ = run(SceneHeader(table.degree), in_blocks(table, 7), [step])
    np.testing.assert_allclose(gather(blocks, header, len(table)).sh, after.sh, atol=1e-6)


def test_opacities_are_set_and_scaled():
    table = shiny_table()
    half = apply(table, Opacity(scale=0.5, selection=LEFT))
    inside = LEFT.mask(table)
    np.testing.assert_allclose(half.opacities[inside], table.opacities[inside] / 2, atol=1e-6)
    np.testing.assert_array_equal(half.logit_opacities[~inside], table.logit_opacities[~inside])
    for value in (0.0, 0.3, 1.0):
        done = apply(table, Opacity(value))
        assert np.isfinite(done.logit_opacities).all()
        np.testing.assert_allclose(done.opacities, value, atol=2e-6)
    assert (apply(table, Opacity(scale=100.0)).opacities > 0.999).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"temperature": 100.0}, "kelvin, 1667"),
        ({"exposure": float("nan")}, "finite"),
        ({"saturation": -1.0}, "0 or more"),
        ({"curve": ((0.3, 0.6), (0.6, 0.2))}, "falls"),
        ({"curve": ((0.3, 0.6), (0.3, 0.7))}, "one place"),
        ({"curve": ((0.3, 1.6),)}, "from 0 to 1"),
    ],
)
def test_values_out_of_range_are_named(values, message):
    with pytest.raises(UsageError, match=message):
        Grade(**values)
