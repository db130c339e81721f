"""The claims of the paper are judged from records alone; a descent is that of gsedit's strokes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from research.painting import judge
from research.painting.arms import STEPS, Descent
from research.painting.cases import Case
from research.painting.judge import Cells, Claim, Contrast, draw, factors, read_records, report

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.strokes import RATE, stroke_steps
from gsedit.errors import InputError
from gsedit.measures.features import FilterBank
from gsedit.views.dataset import View
from rasterizer.color_weights import color_weights
from rasterizer.render import render

CELLS = [(scene, style) for scene in ("bear", "garden", "dinosaur") for style in "abcd"]
NEARER = Claim("", (Contrast("perceptual", "base", "mse", -1),))


def record(cell, arm, at=None, seed=0, **fields):
    scene, style = cell
    row = dict.fromkeys(judge.FIELDS)
    return {**row, "scene": scene, "style": style, "arm": arm, "seed": seed, "at": at, **fields}


def judged(claim, differences):
    rows = []
    for cell, difference in zip(CELLS, differences):
        rows.append(record(cell, "mse", perceptual=0.5))
        rows.append(record(cell, "base", perceptual=0.5 + difference))
    return claim.judge(Cells(rows))[0]


@pytest.mark.parametrize(
    ("differences", "verdict"),
    [
        ([-0.1 - 0.01 * k for k in range(12)], "seen"),
        ([0.1 + 0.01 * k for k in range(12)], "opposite seen"),
        ([0.1 * (-1) ** k for k in range(12)], "not seen"),
        ([-0.1, -0.11, -0.12], "not judged"),  # three cells have no interval
        ([], "not judged"),
    ],
)
def test_a_verdict_is_where_the_interval_is(differences, verdict):
    assert judged(NEARER, differences) == verdict


def test_a_margin_forgives_what_is_less():
    lenient = Claim("", (NEARER.tests[0]._replace(margin=0.05),))
    differences = [0.02 + 0.001 * k for k in range(12)]
    assert judged(NEARER, differences) == "opposite seen"
    assert judged(lenient, differences) == "seen"


def test_tests_that_part_are_seen_in_part():
    both = Claim("", (*NEARER.tests, Contrast("perceptual", "base", "mse", 1)))
    assert judged(both, [-0.1 - 0.01 * k for k in range(12)]) == "in part"


def test_seeds_are_averaged_within_a_cell():
    rows = [record(CELLS[0], "random", seed=k, perceptual=0.1 * k) for k in range(3)]
    assert Cells(rows).value(CELLS[0], "random", "perceptual") == pytest.approx(0.1)


def curves(iterative, edits=60):
    rows = []
    for cell in CELLS[:4]:
        for at, single, other in zip((5.0, 10.0, 20.0), (0.4, 0.35, 0.3), iterative):
            counts = {"seconds": at, "steps": 20 * at}
            rows.append(record(cell, "single", at, perceptual=single, edits=18, **counts))
            rows.append(record(cell, "iterative", at, perceptual=other, edits=edits, **counts))
    return Cells(rows)


def test_a_factor_is_of_costs_and_at_least_where_it_is_not_reached():
    assert factors(curves((0.6, 0.5, 0.4)), paper=False) == [(4.0, True)] * 4
    assert factors(curves((0.6, 0.5, 0.45)), paper=False) == [(4.0, False)] * 4
    expected = pytest.approx((60 * 7.5 + 400 * 0.15) / (18 * 7.5 + 100 * 0.15))
    assert factors(curves((0.6, 0.5, 0.4)), paper=True)[0][0] == expected


def test_ten_times_is_not_reached_or_not_judged_but_never_opposite():
    assert judge.judge_tenfold(curves((0.6, 0.5, 0.4)))[0] == "not reached"
    assert judge.judge_tenfold(curves((0.6, 0.5, 0.45)))[0] == "not judged"
    assert judge.judge_tenfold(curves((0.3, 0.3, 0.3)))[0] == "not reached"
    assert judge.judge_tenfold(Cells([]))[0] == "not judged"


def test_the_end_is_not_judged_before_the_iterative_update_has_painted_all_twice():
    end = Claim("", (Contrast("perceptual", "single", "iterative", -1, judge.END),), painted=108)
    few, enough = (end.judge(curves((0.6, 0.5, 0.4), edits))[0] for edits in (107, 108))
    assert (few, enough) == ("not judged", "seen")


def test_records_are_judged_again_from_their_file(tmp_path):
    rows = [
        record(cell, arm, perceptual=0.5, energy=0.4) for cell in CELLS for arm in ("base", "mse")
    ]
    file = tmp_path / "records.csv"
    lines = [",".join(str(judge.number(row[f])) for f in judge.FIELDS) for row in rows]
    file.write_text("\n".join([",".join(judge.FIELDS), *lines]) + "\n")
    assert read_records(file) == rows
    assert "| base | 12 | 0.400 | 0.500 |" in report(read_records(file))
    draw(rows, tmp_path / "paper.png")
    assert (tmp_path / "paper.png").stat().st_size > 10_000
    file.write_text("scene,style\nbear,comic\n")
    with pytest.raises(InputError, match="no records"):
        read_records(file)


def test_the_page_has_the_verdicts_and_means_of_its_records():
    docs = Path(__file__).parents[2] / "docs/measurements"
    page = (docs / "paper.md").read_text()
    lines = report(read_records(docs / "data/paper.csv")).splitlines()
    assert [line for line in lines if " s | " not in line and line not in page] == []


def test_the_descent_is_that_of_gsedit():
    scene = surface_gaussians(demo_scene(), 400, torch.Generator().manual_seed(0))
    cameras = tuple(ring_cameras(demo_scene(), 3, 64))
    pictures = [render(scene, camera).color for camera in cameras]
    targets = [picture.clamp(0, 1).flip(-1) for picture in pictures]
    share = torch.full((64, 64), 0.5)
    views = [View(str(i), *each) for i, each in enumerate(zip(cameras, targets))]
    inside = torch.ones(len(scene), dtype=torch.bool)
    *_, expected = stroke_steps(
        scene, views, inside, STEPS, FilterBank(), torch.Generator().manual_seed(0),
        weights=[replace(color_weights(scene, each), wanted=share) for each in cameras],
    )  # fmt: skip
    none = torch.zeros(0, 0)
    case = Case("", scene, cameras, (0, 1, 2), (0, 1, 2), (), none, {}, {}, {}, {}, 0.0)
    descent = Descent(scene, case, "sum", 10.0, 0)
    for i, target in enumerate(targets):
        descent.put(i, target, share)
    for step in range(STEPS):
        descent.step(descent.next_view(), RATE * (1 - 0.9 * step / STEPS))
    assert torch.allclose(descent.scene.sh, expected.sh, atol=1e-4)
    assert not torch.allclose(descent.scene.sh, scene.sh, atol=1e-2)
