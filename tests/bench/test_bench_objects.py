"""The benchmark of objects: its files, its measures, and results of somebody else."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import torch
from bench.objects import run
from bench.objects.cases import CASES, Case
from bench.objects.choosing import CLICKS, clicking
from bench.objects.files import CAMERAS, Size, read_case
from bench.objects.methods import METHODS
from bench.objects.phrases import NAMED
from bench.objects.rows import Row, table
from bench.objects.scores import Truth, changes, scores, seam
from bench.staged import stage

from gsedit.datasets.nerfstudio import read_nerfstudio
from gsedit.errors import UsageError
from gsedit.measures.metrics import NEAREST

REMOVAL = next(case for case in CASES if case.name == "removal-glimpse")
TINY = run.Plan(Size(gaussians=2500, side=32), (REMOVAL,), (), ())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("objects")
    list(run.objects_to_folder(place, TINY))
    return place


def rows_of(folder):
    return [json.loads(line) for line in (folder / run.ROWS).read_text().splitlines()]


def test_every_method_has_a_row_with_its_measures_or_a_reason(folder):
    rows = rows_of(folder)
    methods = {row["method"] for row in rows if row["task"] == "removal"}
    assert methods == set(METHODS["removal"])
    assert all(row["measures"] or row["note"] for row in rows)
    by_name = {row["method"]: row["measures"] for row in rows if row["task"] == "removal"}
    assert by_name["drop and blur"]["unseen_psnr"] > by_name["drop only"]["unseen_psnr"]
    assert by_name["drop only"]["outside_psnr"] > 60
    assert all(row["provenance"]["commit"] for row in rows)
    assert "drop only" in (folder / "objects.md").read_text()


def test_the_files_are_read_as_photos_flags_and_scenes(folder):
    given = read_case(REMOVAL, folder)
    photos = read_nerfstudio(folder / "scenes" / "glimpse" / "capture" / CAMERAS).photos
    assert len(photos) == len(given.cameras)
    assert 0 < given.inside.sum() < len(given.scene)
    assert given.truth.hole.any()
    assert not (given.truth.unseen & ~given.truth.hole).any()
    assert not (given.truth.hole & ~given.truth.changed).any()


def test_somebodys_result_is_measured_instead(folder, tmp_path):
    cases, result = tmp_path / "cases", tmp_path / "result"
    shutil.copytree(folder, cases)
    result.mkdir()
    shutil.copy(folder / "cases" / REMOVAL.name / "truth.ply", result / f"{REMOVAL.name}.ply")
    list(run.objects_to_folder(cases, TINY, result))
    (row,) = rows_of(cases)
    assert row["method"] == run.RESULT
    assert row["measures"]["hole_psnr"] > 50  # pictures have 8 bits
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match="no result of any case"):
        list(run.objects_to_folder(cases, TINY, tmp_path / "empty"))
    with pytest.raises(UsageError, match="another size"):
        list(run.objects_to_folder(cases))


def test_equal_pictures_are_nearest_and_an_error_in_the_hole_is_a_seam():
    noise = torch.rand(2, 40, 40, 3, generator=torch.Generator().manual_seed(0))
    before, after = noise.clone(), noise.clone()
    hole = torch.zeros(2, 40, 40, dtype=torch.bool)
    hole[:, 10:20, 12:22] = True
    before[hole] = 0.0
    truth = Truth(after, changes(before, after), hole, torch.zeros_like(hole))
    equal = scores(after, before, truth)
    assert equal["hole_psnr"] == equal["changed_psnr"] == NEAREST
    assert equal["unseen_psnr"] is None
    assert equal["seam"] is None
    rough = after + 0.01 * torch.randn(after.shape, generator=torch.Generator().manual_seed(1))
    assert seam(rough, after, hole) == pytest.approx(1.0, abs=0.15)
    rough[hole] += 0.1
    assert float(seam(rough, after, hole) or 0) > 4


def test_a_right_selection_stays_right_and_an_empty_one_stays_empty():
    meadow = stage("meadow")
    given, cameras = meadow.gaussians(400), meadow.training(24)[:4]
    true = given.of("red ball")
    asked = []

    def oracle(scene, cameras, clicks):
        asked.append(clicks[-1])
        return true

    assert clicking(meadow, given, "red ball", cameras, oracle) == [1.0] * CLICKS
    first = asked[0]
    assert meadow.mask(cameras[first.view], "red ball")[int(first.y), int(first.x)]
    nothing = clicking(meadow, given, "red ball", cameras, lambda scene, *_: true & False)
    assert nothing == [0.0] * CLICKS


def test_cases_have_names_of_their_own_and_things_that_exist():
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES:
        stage(case.stage).thing(case.subject)
    assert sum(map(len, NAMED.values())) == 40
    for name, phrases in NAMED.items():
        for _, thing in phrases:
            stage(name).thing(thing)


def test_tables_have_means_and_say_what_was_refused():
    rows = [
        Row("a", "move", "gsedit", {"changed_psnr": 20.0, "contact": -0.02}),
        Row("b", "move", "gsedit", {"changed_psnr": 30.0, "contact": 0.02}),
        Row("a", "growth", "gsedit", note="nothing faces up"),
        Row("meadow: the red one", "phrase", "gsedit", {"iou": 0.9}),
        Row("meadow: it", "phrase", "gsedit", note="names nothing"),
    ]
    text = table(rows)
    assert "| **mean** | gsedit | 25.0 | +2.0% |" in text
    assert "nothing faces up" in text
    assert "Phrases: 1 of 2" in text


def test_a_moved_thing_stands_where_the_case_says():
    case = next(each for each in CASES if each.task == "move")
    foot = case.after().thing(case.subject).foot
    assert np.allclose(foot, case.change["to"], atol=1e-9)
    assert Case("removal", "wall", "blue crate").after().things == ()
