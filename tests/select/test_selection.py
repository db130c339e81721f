"""Selections: set laws, volumes against their equations, values in human units, in parts."""

from __future__ import annotations

import time

import numpy as np
import pytest

from gsedit.errors import InputError, UsageError
from gsedit.formats.flags import write_flags
from gsedit.formats.streams import SceneHeader, gather, in_blocks
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.kinds import box, cylinder, ellipsoid, half_space, oriented_box, sphere
from gsedit.toolkit import Filter, filter, select, where
from gsedit.toolkit.operation import run
from gsedit.toolkit.transform import rotate
from rasterizer.numerics import SH_DC


def cloud(n: int = 400, spread: float = 1.0) -> SplatTable:
    draw = np.random.default_rng(0)
    shapes = [(n, 3), (n, 4), (n, 3), (n,), (n, 4, 3)]
    arrays = [draw.normal(size=shape).astype(np.float32) for shape in shapes]
    arrays[0] *= spread
    return SplatTable(*arrays, extra={"label": np.arange(n) % 7})


EXPRESSIONS = (
    "opacity > 0.6",
    "0.2 < size <= 1.5",
    "sphere(0, 0, 0, 1)",
    "near(#8090a0, 40)",
    "label == 3",
    "abs(x) + 2 * y ** 2 < 1 / 2",
    "distance(1, 0, -1) >= 1.5",
    "largest(50, opacity)",
    "smallest('10 %', distance(0, 0, 0))",
)


@pytest.mark.parametrize("a", EXPRESSIONS)
@pytest.mark.parametrize("b", EXPRESSIONS[:3])
def test_de_morgan(a, b):
    table = cloud()
    one, other = where(a), where(b)
    laws = {f"not ({a}) or not ({b})": one & other, f"not ({a}) and not ({b})": one | other}
    for text, both in laws.items():
        np.testing.assert_array_equal(select(table, ~both), select(table, text))
    assert 0 < select(table, one).sum() < len(table)


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_in_parts_as_whole(text):
    table, selection = cloud(), where(text)
    header = SceneHeader(1, {"label": table.extra["label"].dtype})
    _, blocks, counts = run(header, in_blocks(table, 37), [Filter(selection=selection)])
    parts = gather(blocks, header, 0)
    whole = filter(table, text)
    np.testing.assert_array_equal(parts.means, whole.means)
    np.testing.assert_array_equal(parts.extra["label"], whole.extra["label"])
    np.testing.assert_array_equal(whole.means, table.means[selection.mask(table)])
    assert counts[0][1].after == len(whole)
    assert counts[0][1].before == len(table)


def test_a_turned_volume_of_a_turned_scene_selects_the_same():
    table, degrees = cloud(), (30.0, -50.0, 110.0)
    turn = rotate(degrees).turn
    center = np.array([0.3, -0.2, 0.5])
    turned = table.replace(means=(table.means @ turn.T).astype(np.float32))
    there = tuple(float(c) for c in turn @ center)
    here = tuple(float(c) for c in center)
    for kind in (oriented_box, ellipsoid):
        before = kind(*here, 1.0, 2.0, 1.5).mask(table)
        after = kind(*there, 1.0, 2.0, 1.5, *degrees).mask(turned)
        np.testing.assert_array_equal(before, after)
        assert 0 < before.sum() < len(table)


def test_volumes_are_their_equations():
    table = cloud()
    x, y, z = table.means.astype(np.float64).T
    cases = {
        box(-1.0, -np.inf, 0.0, 1.0, 0.5, np.inf): (abs(x) <= 1) & (y <= 0.5) & (z >= 0),
        sphere(1.0, 0.0, 0.0, 1.2): (x - 1) ** 2 + y**2 + z**2 <= 1.44,
        ellipsoid(0.0, 1.0, 0.0, 1.0, 2.0, 0.5): x**2 + (y - 1) ** 2 / 4 + z**2 * 4 <= 1,
        oriented_box(0.0, 0.0, 1.0, 1.0, 2.0, 3.0): (abs(x) <= 0.5)
        & (abs(y) <= 1)
        & (abs(z - 1) <= 1.5),
        cylinder(0.0, 0.0, -1.0, 0.0, 0.0, 0.5, 0.8): (x**2 + y**2 <= 0.64)
        & (z >= -1)
        & (z <= 0.5),
        half_space(0.0, 1.0, 0.0, 1.0, 1.0, 0.0): x + y - 1 >= 0,
    }
    for selection, expected in cases.items():
        np.testing.assert_array_equal(selection.mask(table), expected, err_msg=str(selection))
        assert 0 < expected.sum() < len(table)


@pytest.mark.parametrize(
    "text", ["." * 9990, "1." * 4990, f"near('{'a' * 9900}')", " " * 4990 + "x" * 4990, "=" * 9990]
)
def test_a_long_expression_is_read_in_no_time(text):
    start = time.process_time()
    with pytest.raises(UsageError):
        select(cloud(), text)
    assert time.process_time() - start < 0.5
    with pytest.raises(UsageError, match="characters, 10000 are allowed"):
        select(cloud(), 2 * text)


def test_values_are_in_human_units():
    table = cloud()
    scales = np.exp(table.log_scales.astype(np.float64))
    values = {
        "opacity > 0.3": 1 / (1 + np.exp(-table.logit_opacities)) > 0.3,
        "size < 0.8": scales.prod(1) ** (1 / 3) < 0.8,
        "longest < 0.8": scales.max(1) < 0.8,
        "shortest < 0.8": scales.min(1) < 0.8,
        "anisotropy > 3": scales.max(1) / scales.min(1) > 3,
        "green > 0.5": 0.5 + SH_DC * table.sh[:, 0, 1] > 0.5,
    }
    for text, expected in values.items():
        np.testing.assert_array_equal(select(table, text), expected, err_msg=text)


def test_near_is_a_distance_in_lab():
    table = cloud(3)
    sh = np.zeros_like(table.sh)
    sh[:, 0] = (np.array([[1, 1, 1], [1, 0, 0], [0.5, 0.5, 0.5]]) - 0.5) / SH_DC
    table = table.replace(sh=sh)
    # CIE Lab of white, of sRGB red (53.24, 80.09, 67.20) and of grey (53.39, 0, 0)
    assert select(table, "near(#fff, 0.1)").tolist() == [True, False, False]
    assert select(table, "near(#ffffff, 46.7)").tolist() == [True, False, True]
    assert select(table, "near('#808080', 104.6)").tolist() == [True, True, True]
    assert select(table, "near('#808080', 104.3)").tolist() == [True, False, True]


def test_near_takes_the_color_of_a_pixel(tmp_path):
    from PIL import Image

    path = tmp_path / "photo.png"
    picture = Image.new("RGB", (4, 3))
    picture.putpixel((3, 1), (128, 144, 160))
    picture.save(path)
    table = cloud()
    np.testing.assert_array_equal(
        select(table, f"near('{path}@3,1', 40)"), select(table, "near(#8090a0, 40)")
    )
    for place, message in (("4,1", "4x3 pixels"), ("x,1", "column and row"), ("1", "column and")):
        with pytest.raises(UsageError, match=message):
            where(f"near('{path}@{place}')")
    with pytest.raises(InputError, match="cannot be read"):
        where("near('none.png@0,0')")


def test_the_n_largest_are_n_and_none_left_is_larger():
    table = cloud()
    inside = select(table, "largest('12.5%', opacity)")
    assert inside.sum() == 50
    assert table.logit_opacities[inside].min() >= table.logit_opacities[~inside].max()
    assert select(table, "smallest(1000, x)").all()
    means = table.means.copy()
    means[7, 0] = np.nan
    broken = table.replace(means=means)
    assert not select(broken, "largest(399, x)")[7]
    assert not select(broken, "smallest(399, x)")[7]


def test_a_row_that_is_not_a_number_is_selected_by_the_complement():
    table = cloud(2)
    table.means[0] = np.nan
    for text in ("box(-9, -inf, -9, 9, inf, 9)", "sphere(0, 0, 0, 9)", "x < 9"):
        assert select(table, text).tolist() == [False, True], text
        assert select(table, f"not {text}").tolist() == [True, False], text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 3e38, -3e38])
def test_rows_of_any_numbers_are_selected_without_a_warning(wrong):
    good, table = cloud(20), cloud(20)
    for name in ("means", "log_scales", "logit_opacities", "sh"):
        getattr(table, name)[3] = wrong
    forms = (
        "box(-2, -2, -2, 2, 2, 2)", "oriented_box(0, 0, 0, 2, 2, 2, 10, 20, 30)",
        "ellipsoid(0, 0, 0, 1, 2, 3, 10, 20, 30)", "cylinder(0, 0, 0, 1, 1, 1, 1)",
        "half_space(0, 0, 0, 1, 1, 1)", "x + y > 0", "luminance > 0.5", "longest < 1",
        "shortest < 1", "anisotropy < 3", "red - blue > 0", "grow(x > 0, 0.5)",
        "shrink(x > 0, 0.5)", "cluster(gap=0.5)", *EXPRESSIONS[:-2],
    )  # fmt: skip
    for text in forms:
        others = np.arange(20) != 3
        np.testing.assert_array_equal(
            select(table, text)[others], select(good[others], text), err_msg=text
        )


def test_numbers_are_neither_cut_off_nor_wrapped_round():
    table = cloud(3)
    assert select(table, "largest(1234567, x)").all()
    assert select(table, "sphere(0, 0, 0, 1e200) and cylinder(0, 0, 0, 0, 0, 9, 1e200)").any()
    table = table.replace(extra={"a": np.uint8([10, 200, 9]), "b": np.uint8([11, 100, 20])})
    assert select(table, "abs(a - b) < 20").tolist() == [True, False, True]
    assert select(table, "a + b > 255").tolist() == [False, True, False]


def test_flags_are_saved_and_read_again(tmp_path):
    table, path = cloud(), tmp_path / "region.npy"
    write_flags(select(table, "x > 0"), path)
    text = f"flags('{path}') and y > 0"
    np.testing.assert_array_equal(select(table, text), select(table, "x > 0 and y > 0"))
    with pytest.raises(InputError, match=r"shape \(400,\) and the scene has 399"):
        select(table[1:], text)


def test_a_scene_of_tensors_stays_one():
    scene = gaussians_of(cloud())
    kept = filter(scene, "opacity > 0.5")
    assert type(kept) is type(scene)
    assert (kept.logit_opacities > 0).all()
    assert len(kept) == select(scene, "opacity > 0.5").sum()


@pytest.mark.parametrize(
    ("text", "place", "move"),
    [
        ("", "", "give one, as in opacity > 0.1"),
        ("opacity > 0.1 and spere(0,0,0,1)", "'spere(0,0,0,1)' (character 19)", "mean sphere?"),
        ("opacity >", "at the end", ""),
        ("x > 1 and sphere(0,0,1)", "'sphere(0,0,1)' (character 11)", "sphere(x, y, z, radius)"),
        ("near(#a08050, -1)", "'near(#a08050, -1)'", "more than 0"),
        ("near(#a0805, 1)", "'#a0805' (character 6)", "as #a08050"),
        ("largest(10%, opacity)", "'10%' (character 9)", "quote a share"),
        ("opacity = 0.1 and x > 1", "'=' (character 9)", "compare with =="),
        ("opacity", "'opacity' (character 1)", "compare it"),
        ("opacity > 0.1 & x > 1", "'0.1 & x'", "write and, or, not"),
        ("__import__('os').system('x') > 1", "", "no number"),
        ("(lambda: 1)() > 0", "", "no number"),
        ("sphere(0,0,0,1) > 1", "'sphere(0,0,0,1)'", "a condition where a number is needed"),
        ("x > 'a'", "\"'a'\"", "no number"),
        ("1 < 2", "'1 < 2'", "two numbers"),
        ("x in (1, 2)", "(1, 2)", "no number"),
        ("sphere", "'sphere'", "write sphere(x, y, z, radius)"),
        ("largest('many', x)", "'many'", "as in 10%"),
        ("é > 1 and spere(1)", "'spere(1)' (character 11)", "mean sphere?"),
        ("box(1,0,0,0,1,1)", "box", "lower corner first"),
        ("(" * 4000 + "x" + ")" * 4000 + " > 1", "", ""),
        ("9" * 5000 + " > x", "", ""),
        ("x" + " + x" * 2000 + " > 1", "", "too deep"),
        ("not " * 180 + "x > 1", "", "too deep"),
        ("largest(2.5, x)", "'2.5'", "a whole number"),
        ("sphere(0, 0, 0, 0)", "sphere", "more than 0"),
        ("sphere(0, inf, 0, 1)", "sphere", "not all finite"),
        ("oriented_box(0, 0, 0, 1, -1, 1)", "oriented_box", "more than 0"),
        ("cylinder(0, 0, 0, 0, 0, 0, 1)", "cylinder", "give two"),
        ("half_space(0, 0, 0, 0, 0, 0)", "half_space", "give a direction"),
        ("cluster(0)", "cluster", "1 or more"),
        ("cluster(gap=0)", "cluster", "more than 0"),
        ("cluster_at(0, 0, inf)", "cluster_at", "not all finite"),
        ("grow(all(), 0)", "grow", "more than 0"),
        ("shrink(all(), -1)", "shrink", "more than 0"),
        ("seen('c.json', 0)", "seen", "more than 0"),
        ("middle(0)", "middle", ""),
    ],
)
def test_a_wrong_expression_names_the_place(text, place, move):
    with pytest.raises(UsageError) as caught:
        where(text)
    assert place in str(caught.value)
    assert move in str(caught.value)


def test_an_unknown_name_is_told_with_the_columns_of_the_scene():
    with pytest.raises(UsageError, match="labell: did you mean label"):
        select(cloud(), "labell == 1")
