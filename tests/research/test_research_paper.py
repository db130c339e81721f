"""The paper's experiments: what a run records, what speed-ups mean, the files that are left."""

from __future__ import annotations

import json
from dataclasses import replace
from math import isclose
from pathlib import Path

import pytest
import torch
from research.paper import __main__ as main
from research.paper import folder, measure
from research.paper.claims import claims
from research.paper.measure import run_to_files
from research.paper.runs import Arm, Case, Record, Run, read_record
from research.paper.statistics import (
    COSTLY,
    MEASURED,
    PAPERS,
    Costs,
    final_error,
    median_scene,
    race,
)
from research.paper.studies import FULL, QUICK, Study, capture_case, studies
from research.paper.tables import write_tables

from gsedit.bench.edit import Point
from gsedit.editing.strategies import find_strategy
from gsedit.errors import InputError, UsageError

CASE = Case("globe", "make it night", 32, 1, 32, 150, 9)
SHORT = Arm(
    "single-pass", "single-pass", {"update_steps": 12}, {"batches": 1, "update.loss": "mse+gram"}
)
SLOW = Arm("iterative", "iterative", {"total_steps": 10, "steps_between": 5})


def record(errors: list[float], evaluations: int, step_seconds: float = 0.1) -> Record:
    """Ten steps and `evaluations` a point, half a second of editing."""
    points = [
        Point(k * (10 * step_seconds + 0.5), 0.5 * k, 10 * k, k, k * evaluations, (1.0, error))
        for k, error in enumerate(errors)
    ]
    return Record(
        tuple(points), measure.EXACT, 0.1, 0.1, 0.5, 0.1, 1.0, 1.0, 0.2, 1, "abc", "machine", "now"
    )


def test_the_error_is_to_the_variant_that_the_edit_ends_nearest_to():
    assert record([0.5, 0.2], 1).errors == (0.5, 0.2)


def test_a_race_is_to_iteratives_final_error():
    iterative = record([0.5, 0.4, 0.3, 0.2, 0.2], 60)
    fast = record([0.5, 0.2, 0.1], 60)
    assert final_error(iterative) == 0.2
    found = race(fast, iterative)
    assert found.own is not None
    assert (found.own.steps, found.iterative.steps) == (10, 30)
    assert found.speed_up(MEASURED) == pytest.approx(3)
    assert found.speed_up(COSTLY) == pytest.approx(3)
    assert race(record([0.5, 0.3], 60), iterative).speed_up(COSTLY) == 0  # it is not reached


def test_the_cost_of_an_evaluation_decides_the_speed_up():
    iterative = record([0.5, 0.3, 0.2, 0.2], 10)
    frugal = record([0.5, 0.4, 0.3, 0.25, 0.2], 1)  # more steps, fewer evaluations
    factors = [
        race(frugal, iterative).speed_up(Costs("", cost, 0.1)) for cost in (0.01, 1.0, 100.0)
    ]
    assert factors[0] < 1 < factors[1] < factors[2] < 5
    assert PAPERS.seconds(iterative.curve[2]) == pytest.approx(20 * 0.15 + 20 * 0.05)


def test_the_median_scene_counts_what_is_not_reached_as_no_speed_up():
    iterative = record([0.5, 0.4, 0.2], 10)
    good, bad = race(record([0.5, 0.1], 10), iterative), race(record([0.5], 10), iterative)
    assert median_scene({"a": [good, good, bad], "b": [bad], "c": [good]}, COSTLY) == 2
    assert median_scene({"a": [bad, good]}, COSTLY) == 0  # not half of a speed-up


@pytest.mark.parametrize("size", [QUICK, FULL])
def test_every_arm_is_one_that_gsedit_accepts(size):
    found = studies(size, capture_case("bear.ply", "", size))
    runs = [run for study in found for run in study.runs]
    for run in {run.key: run for run in runs}.values():
        find_strategy(run.arm.strategy)(**run.arm.options)
        assert measure._settings(run).region == "all"
    assert {run.editor for run in runs} == {"closed-form", "small"}
    assert len({study.name for study in found}) == len(found)


def test_equal_work_has_one_key_whatever_it_is_called():
    run = Run(SHORT, CASE, "closed-form", 0)
    assert run.key == replace(run, arm=replace(SHORT, label="another")).key
    assert run.key != replace(run, seed=1).key
    assert run.key != replace(run, arm=replace(SHORT, settings={"batches": 2})).key


def test_settings_reach_the_records_inside():
    arm = replace(SHORT, settings={"sampler.target": "xt", "update.loss": "l1"})
    settings = measure._settings(Run(arm, CASE, "closed-form", 0))
    assert (settings.sampler.target, settings.update.loss) == ("xt", "l1")
    assert settings.sampler.precision == "float32"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A tiny bench in a folder, run once."""
    where = tmp_path_factory.mktemp("paper")
    runs = tuple(Run(arm, CASE, "closed-form", seed) for seed in (0, 1) for arm in (SHORT, SLOW))
    found = (Study("strategies", "Strategies", "Figure 9", runs),)
    events = [*folder.paper_to_folder(where, QUICK, found, jobs=1, skipped="No capture.")]
    return where, found, events


def test_a_run_records_its_curve_outside_its_clock(done):
    where, found, events = done
    assert [(event.step, event.steps) for event in events] == [(k, 4) for k in (1, 2, 3, 4)]
    first = read_record(where / "runs" / f"{found[0].runs[0].key}.json")
    assert first.curve[0].seconds < 0.05  # the pictures that are right are made before
    assert [point.steps for point in first.curve] == [0, 10, 12]
    assert first.curve[-1].calls == 3
    assert first.curve[-1].evaluations == 3 * 3 * 20
    assert 0 < first.curve[-1].editing < first.curve[-1].seconds
    assert first.errors[-1] < first.errors[0]


def test_a_run_ends_where_the_same_run_ended(done):
    where, found, _ = done
    run = found[0].runs[0]
    again, _ = measure.measure_run(run)
    kept = read_record(where / "runs" / f"{run.key}.json")
    assert again.errors[-1] == pytest.approx(kept.errors[-1], rel=1e-4)


def test_a_run_that_is_done_is_not_repeated(done, monkeypatch):
    where, found, _ = done
    monkeypatch.setattr(measure, "measure_run", lambda run: pytest.fail("it was repeated"))
    for run in found[0].runs:
        assert run_to_files(run, where / "runs").truth == measure.EXACT


def test_a_broken_run_says_what_to_do(tmp_path):
    path = tmp_path / "x.json"
    path.write_text('{"run": ')
    with pytest.raises(InputError, match=r"x\.json.*delete it"):
        read_record(path)


def test_the_summary_holds_every_number_with_its_spread(done):
    where, _, _ = done
    summary = json.loads((where / "summary.json").read_text())
    arms = summary["studies"]["strategies"]["editors"]["closed-form"]
    assert set(arms) == {"single-pass", "iterative"}
    assert arms["iterative"]["calls"]["mean"] == 2
    assert arms["single-pass"]["final_db"]["count"] == 2
    assert summary["skipped"] == "No capture."
    costly = summary["editors"]["closed-form"]["speed_up"]["costly"]["single-pass"]
    assert set(costly["scenes"]) == {"globe"}
    assert any("10 times" in claim.text for claim in claims(summary))


def test_the_report_is_one_file(done):
    where, _, _ = done
    page = (where / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 4
    assert "http" not in page
    assert "<script" not in page
    assert "figure 9" in page


def test_tables_are_written_between_markers(done, tmp_path):
    where, _, _ = done
    page = tmp_path / "page.md"
    page.write_text("# A\n\n<!-- speed-up -->\nold\n<!-- end speed-up -->\n\nlast\n")
    folder.write_docs(page, where)
    text = page.read_text()
    assert "old" not in text
    assert "| closed-form: single-pass |" in text
    assert text.startswith("# A\n\n<!-- speed-up -->\n")
    assert text.endswith("<!-- end speed-up -->\n\nlast\n")
    folder.write_docs(page, where)
    assert page.read_text() == text
    assert write_tables("no markers\n", {"speed-up": "x"}) == "no markers\n"


def test_the_command_says_what_it_leaves_out(monkeypatch, tmp_path, capsys, done):
    where, found, _ = done
    monkeypatch.setattr(main, "studies", lambda size, capture: found)
    main.paper(Path("none.ply"), out=where, quick=True, jobs=1)
    printed = capsys.readouterr()
    assert "none.ply is not there" in printed.err
    assert printed.out == f"{where / 'report.html'}\n"
    with pytest.raises(UsageError, match=r"missing\.md is not there"):
        main.paper(out=where, docs=tmp_path / "missing.md")


def test_gradient_energy_is_of_neighbors():
    ramp = torch.linspace(0, 1, 5)[None, :, None].expand(4, 5, 3)
    assert isclose(measure._energy(ramp[None]), 0.25**2, rel_tol=1e-6)
