"""The paper's experiments: verdicts, records, speed-ups, arms, and the files that are left."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from math import inf
from pathlib import Path

import pytest
import torch
from research.paper import claims, folder, measure
from research.paper.arms import ONE_IN, ONE_OUT, STEPS, base_of, baseline_arms, preset_arms
from research.paper.cases import captured
from research.paper.measure import run_to_file, settings_of, strategy_of
from research.paper.observe import EXACT, Point
from research.paper.race import final_error, race, regimes
from research.paper.runs import Arm, Case, Record, Run, read_record
from research.paper.studies import BRANCHES, FULL, QUICK, Study, distinct, studies
from research.paper.varied import Varied

from gsedit.paper.diffusion.sampler import levels_of
from gsedit.paper.editors import EditBatch
from gsedit.paper.editors.sampling import DiffusionEditor
from gsedit.paper.settings import PRESETS

CASE = Case("globe", "make it night", 32, 1, 32, 150, 9)
SHORT = Arm("paper", "paper", options={"update_steps": 12}, settings={"batches": 1})
SLOW = Arm("iterative", "paper", "iterative", {"total_steps": 10, "steps_between": 5})
MEASURED, REAL = regimes().values()


# ---- claims --------------------------------------------------------------------------------------


def summary_of(arms, editors=("varied",), races=()):
    """Made-up rows: values of final_db by arm, equal on three scenes but for 0.01."""
    rows = [
        {"study": "paper", "arm": arm, "editor": editor, "scene": scene, "seed": 0}
        | dict.fromkeys(("disagreement", "target_sharpness", "sharpness"))
        | {"final_db": value + 0.01 * k, "unedited_disagreement": 0.0}
        for arm, value in arms.items()
        for editor in editors
        for k, scene in enumerate(("a", "b", "c"))
    ]
    return {"rows": rows, "races": list(races)}


def verdicts(summary):
    judged = claims.judgements(summary)
    return {claim.text: found.verdict for claim, found in judged if found is not None}


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [(1.0, "reproduced"), (0.2, "direction only"), (0, "less than half"), (-0.7, "opposite")],
)
def test_claims_follow_the_rule(gain, verdict):
    rough = {"paper: MSE": 20.0, "paper": 20.0 + gain}
    summary = summary_of(rough, editors=("closed-form", "varied"))
    if not gain:
        summary["rows"][0]["final_db"] += 0.1
        summary["rows"][1]["final_db"] -= 0.1
    found = verdicts(summary)
    assert [found[text] for text in found if "style loss" in text] == [verdict]
    table = claims.claims_table(summary)
    assert f"**{verdict}**" in table
    assert table.count("not measured") == len(claims.CLAIMS) - 1


@pytest.mark.parametrize(("gap", "verdict"), [(0.0, "reproduced"), (-3.0, "opposite")])
def test_comparable_is_within_a_margin(gap, verdict):
    found = verdicts(summary_of({"paper": 30 + gap, "iterative": 30.0}))
    assert [word for text, word in found.items() if "comparable" in text] == [verdict]


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(12.0, "reproduced"), (2.0, "direction only"), (1.0, "less than half"), (0.0, "not reached")],
)
def test_ten_times_is_judged_by_five(factor, verdict):
    races = [
        {"arm": "paper", "editor": "varied", "scene": s, "seed": 0, "real": factor}
        | {"measured": 1.0}
        for s in "abcdef"
    ]
    found = verdicts(summary_of({}, races=races))
    assert found[f"{claims.FASTER}: as printed, at the cost of InstructPix2Pix here"] == verdict


# ---- speed-ups -----------------------------------------------------------------------------------


def record(errors: list[float], evaluations: int, step_seconds: float = 0.1) -> Record:
    """Ten steps and `evaluations` a point, 0.5 s of editing; the clock runs twice as far."""
    points = []
    for k, error in enumerate(errors):
        cpu = k * (10 * step_seconds + 0.5)
        place = (2 * cpu, 1.0 * k, 10 * k, k, k * evaluations)
        points.append(Point(*place, (1.0, error), cpu, 0.5 * k))
    rest = (3.0, 1, "abc", "machine", "now")
    return Record(tuple(points), EXACT, 0.1, 0.1, 0.5, 0.1, 0.1, 1.0, 1.0, *rest)


def test_a_race_is_to_iteratives_final_error_in_processor_seconds():
    iterative = record([0.5, 0.4, 0.3, 0.2, 0.2], 60)
    assert iterative.errors[-1] == final_error(iterative) == 0.2
    found = race(record([0.5, 0.2, 0.1], 60), iterative)
    assert found.own is not None
    assert (found.own.steps, found.iterative.steps) == (10, 30)
    assert found.speed_up(MEASURED) == pytest.approx(3)
    busy = replace(found.own, seconds=1e6)  # a busy machine changes no speed-up
    assert replace(found, own=busy).speed_up(MEASURED) == pytest.approx(3)
    assert race(record([0.5, 0.3], 60), iterative).speed_up(REAL) == 0  # it is not reached
    assert claims.log_factor(0.0) == -inf


# ---- arms ----------------------------------------------------------------------------------------


def test_every_arm_is_one_that_gsedit_accepts():
    bear = captured(Path("bear.ply"), None, 256)
    runs = distinct(studies(FULL, [bear])).values()
    for run in runs:
        strategy_of(run)
        assert settings_of(run).region == "all"
    assert {run.editor for run in runs} == {"closed-form", "varied"}
    assert {run.seed for run in runs if run.case is not bear} == set(range(5))
    assert {run.case.name for run in runs} > {bear.name}


@pytest.mark.parametrize(("preset", "changes"), [("paper", ONE_IN), ("default", ONE_OUT)])
def test_arms_differ_in_one_thing_from_their_base(preset, changes):
    arms = {arm.label: arm for arm in preset_arms(preset)}
    run = Run(arms[preset], CASE, "varied", 0)
    own, usual = settings_of(run), PRESETS[preset].settings
    t_end = own.sampler.t_end if preset == "paper" else None
    assert own.sampler == replace(usual.sampler, precision="float32", t_end=t_end, steps=STEPS)
    assert own.update.loss == usual.update.loss
    for label, arm in arms.items():
        base = base_of(label)
        assert base is None or settings_of(replace(run, arm=arm)) != settings_of(
            replace(run, arm=arms[base])
        )
    assert {base_of(f"{preset}: {name}") for name in changes} <= arms.keys()


def test_arms_that_are_raced_have_equal_denoising_steps():
    """Whatever the editor's own number is."""
    arms = [*preset_arms("paper"), *preset_arms("default"), *baseline_arms(3000)]
    runs = [Run(arm, CASE, editor, 0) for arm in arms for editor in BRANCHES]
    assert {settings_of(run).sampler.steps for run in runs} == {STEPS}


@pytest.mark.parametrize(
    ("steps", "settings"),
    [(10, {}), (50, {"averaged_steps": 50}), (4, {"sampler.steps": STEPS})],
)
def test_t_end_is_a_number_of_steps(steps, settings):
    arm = Arm("paper", "paper", settings=settings)
    sampler = settings_of(Run(arm, CASE, "varied", 0)).sampler
    schedule = measure._editor("varied").capabilities.denoiser.schedule
    levels = levels_of(schedule, sampler)[:-1]
    assert sum(level.sigma > sampler.consensus_end for level in levels) == steps


def test_a_switch_is_drawn_by_the_step_however_often_its_terms_are_read():
    arm = Arm("x", "paper", settings={"update.switch": 0.5})
    update = settings_of(Run(arm, CASE, "varied", 0)).update
    names = [term.name for step in range(2000) for term in update.terms_at(step)]
    assert names[:50] == [term.name for step in range(50) for term in update.terms_at(step)]
    assert len(names) == 2000
    assert names.count("gram") / 2000 == pytest.approx(0.5, abs=0.05)
    alike = sum(a == b for a, b in pairwise(names)) / 1999
    assert alike == pytest.approx(0.5, abs=0.05)  # neighbors are independent


# ---- the editor with random answers --------------------------------------------------------------


def test_answers_vary_about_the_exact_edit_and_agree_where_noise_is_shared():
    editor, settings = DiffusionEditor(Varied()), PRESETS["paper"].settings.sampler
    pictures = torch.rand(1, 4, 4, 3, generator=torch.Generator().manual_seed(0))
    smooth = torch.nn.functional.interpolate(pictures.movedim(-1, 1), (32, 32), mode="bilinear")
    views = smooth.movedim(1, -1).expand(24, 32, 32, 3)
    batch = EditBatch(views, views, "make it night")
    *_, last = editor.edit(batch, settings, torch.Generator().manual_seed(1))
    exact = editor.capabilities.find_ground_truth("make it night", last.images, views)(views)
    away = last.images - exact
    assert float(away.std()) > 0.03
    assert float(away.mean(0).square().mean().sqrt()) < 0.5 * float(away.square().mean().sqrt())
    coarse = away.movedim(-1, 1).reshape(24, 3, 4, 8, 4, 8).mean((3, 5))
    assert float(coarse.std()) > 0.5 * float(away.std())  # blotches rather than grain


# ---- runs and files ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A tiny bench in a folder, run once."""
    where = tmp_path_factory.mktemp("paper")
    runs = tuple(Run(arm, CASE, "varied", seed) for seed in (0, 1) for arm in (SHORT, SLOW))
    broken = Run(replace(SHORT, settings={"views_per_batch": -1}), CASE, "varied", 0)
    found = (Study("strategies", (*runs, broken)),)
    events = [*folder.run_all(where, found, jobs=1)]
    folder.write_results(where, QUICK, found)
    return where, found, events


def test_a_run_records_its_curve_outside_its_clock(done):
    where, found, events = done
    assert [(event.step, event.steps) for event in events] == [(k, 5) for k in (1, 2, 3, 4, 5)]
    first = read_record(where / "runs" / f"{found[0].runs[0].key}.json")
    assert first.curve[0].cpu < 0.05  # the pictures that are right are made before
    assert [point.steps for point in first.curve] == [0, 10, 12]
    assert (first.curve[-1].calls, first.curve[-1].evaluations) == (4, 4 * 50)
    assert 0 < first.curve[-1].editing_cpu < first.curve[-1].cpu < first.cpu
    assert first.errors[-1] < first.errors[0]
    assert len(first.curve[0].errors) == 1  # the true edit of this editor is known


def test_a_run_that_is_done_is_not_repeated(done, monkeypatch):
    where, found, _ = done
    monkeypatch.setattr(measure, "measure_run", lambda *args: pytest.fail("it was repeated"))
    for run in found[0].runs[:4]:
        assert run_to_file(run, where / "runs").truth == EXACT


def test_the_report_is_of_what_ran_and_says_what_did_not(done):
    where, _, _ = done
    summary = json.loads((where / "summary.json").read_text())
    assert (summary["runs"], summary["planned"]) == (4, 5)
    assert summary["missing"] == {"strategies": 1}
    (error,) = summary["failed"].values()
    assert "1 or more" in error
    report = (where / "report.md").read_text()
    assert "4 of 5 runs" in report
    assert "Failed: paper, globe" in report
    assert "| varied: paper |" in report
    assert "not measured" in report
