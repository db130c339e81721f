"""`gsedit edit`: its folder, its options, interruption."""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from command_line import files, gsedit, one_line, stub_checkpoint

from gsedit import Event, load
from gsedit.diffusion.settings import SamplerSettings
from gsedit.errors import GseditError
from gsedit.runs.journal import read_events
from gsedit.select.region import everything
from gsedit.select.saved import save_named


def measurements():
    """An evaluation with two numbers, one of which JSON cannot hold."""
    from gsedit.measures.evaluation_input import Evaluation, Mean

    values = {"rmse_to_unedited": 0.1, "psnr_to_targets": float("inf")}
    means = {name: {"edited": Mean(value, 3)} for name, value in values.items()}
    return Evaluation(means, (), {}, ())


def stub_edit(monkeypatch, *, end: BaseException | None = None):
    from gsedit import EditResult
    from gsedit.editing.session.progress import Work
    from gsedit.editing.session.result import EditMetrics
    from gsedit.editing.view_plan import ViewPlan

    given = {}

    def edit_steps(
        scene, prompt, *, dataset, editor, settings, strategy, features, generator, resume, ranks
    ):
        given.update(prompt=prompt, settings=settings, dataset=dataset, resume=resume)
        update = Event("update", 1.0, 1, 2, 0.5, 0.1)
        yield update
        yield stub_checkpoint(1)
        if end is not None:
            raise end
        measure = Event("measure", 2.0, error=0.05, note="well done")
        yield measure
        yield EditResult(
            prompt=prompt,
            scene=scene,
            originals=dataset.views,
            targets=dataset.views,
            finals=dataset.views,
            settings=settings,
            strategy=strategy,
            strategy_name="single-pass",
            view_plan=ViewPlan(((0,),), (1.0,)),
            region=everything(scene),
            metrics=EditMetrics(measurements(), (("a", "b", 0.5),)),
            work=Work(),
            timings={"total": 2.0},
            events=(update, measure),
        )

    monkeypatch.setattr(import_module("gsedit.editing.edit"), "edit_steps", edit_steps)
    return given


def test_edit_leaves_the_scene_and_its_evidence(monkeypatch, scene, photos, tmp_path):
    given = stub_edit(monkeypatch)
    out = tmp_path / "out"
    more = ("--data", photos, "-o", out, "--batches", 1)
    result = gsedit("edit", scene, "make it impressionist", *more)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip() == str(out / "scene.ply")
    names = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png", "error_vs_time.png"}
    names |= {"cameras.json", "views.json", "region.npy"}
    names |= {"targets/images/0.png", "targets/images/1.png", "targets/images/2.png"}
    assert {path.relative_to(out).as_posix() for path in files(out)} == names
    assert [event.stage for event in read_events(out / "metrics.jsonl")] == ["update", "measure"]
    record = json.loads((out / "edit.json").read_text())
    assert record["instruction"] == given["prompt"] == "make it impressionist"
    assert record["settings"]["batches"] == 1
    assert record["settings"]["sampler"]["steps"] == SamplerSettings().steps
    assert record["measured"]["psnr_to_targets"]["edited"]["value"] is None  # JSON has no infinity
    assert set(record) >= {"seed", "versions", "threads", "timings", "platform", "python"}
    assert gsedit("edit", scene, "make it impressionist", "-o", out).exit_code == 2


def test_an_interrupted_edit_keeps_its_metrics_and_checkpoint(monkeypatch, scene, tmp_path):
    stub_edit(monkeypatch, end=KeyboardInterrupt())
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it impressionist", "-o", out, "--size", 16)
    assert result.exit_code == 130
    assert f"{out / 'checkpoint.safetensors'} (step 1)" in result.stderr
    assert "--resume" in result.stderr
    assert {path.name for path in files(out)} == {
        "checkpoint.safetensors",
        "metrics.unfinished.jsonl",
    }
    assert len(read_events(out / "metrics.unfinished.jsonl")) == 1

    again = ("edit", scene, "make it impressionist", "-o", out, "--size", 16)
    asked = gsedit(*again)
    assert asked.exit_code == 2
    assert "add --resume to continue it, or -f to start again" in asked.stderr
    given = stub_edit(monkeypatch)
    other = gsedit(*again, "--resume", "--editor", "closed-form")
    assert other.exit_code == 2
    assert "editor.editor is closed-form, was small" in other.stderr
    assert gsedit(*again, "--resume").exit_code == 0
    assert given["resume"].record["source"]["scene"] == str(scene)
    assert not (out / "checkpoint.safetensors").exists()
    finished = gsedit(*again, "--resume")
    assert finished.exit_code == 2
    assert "has files in it already" in finished.stderr


LEFT = ("metrics.unfinished.jsonl", ".gs-0123-1-abcd.scene.ply", ".gs-lock.checkpoint.safetensors")


@pytest.mark.parametrize("left", [(), LEFT[:1], LEFT])
def test_a_run_that_kept_nothing_is_repeated_without_force(monkeypatch, scene, tmp_path, left):
    out = tmp_path / "out"
    out.mkdir()
    for name in left:
        (out / name).write_text("")
    stub_edit(monkeypatch)
    assert gsedit("edit", scene, "make it impressionist", "-o", out, "--size", 16).exit_code == 0
    assert {path.name for path in files(out)} >= {"scene.ply", "edit.json"}


def test_a_program_that_failed_does_not_stop_the_next_edit(scene, tmp_path):
    out = tmp_path / "out"
    run = f"{sys.executable} -c 'raise SystemExit(3)' {{input}} {{output}}"
    again = (
        "edit", scene, "as gold", "-o", out, "--size", 16, "--region", "all",
        "--editor", "command", "--run", run,
    )  # fmt: skip
    for _ in range(2):
        failed = gsedit(*again)
        assert failed.exit_code == 1
        assert "it said nothing" in failed.stderr
    assert {path.name for path in out.iterdir()} == {"command", "metrics.unfinished.jsonl"}


def test_the_features_of_the_gram_loss_are_named(monkeypatch, scene, tmp_path):
    given = stub_edit(monkeypatch)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "as gold", "-o", out, "--size", 16, "--features", "gone.pth")
    assert result.exit_code == 3
    assert "gone.pth: no such file" in result.stderr
    monkeypatch.setitem(sys.modules, "stlpips_pytorch", None)  # as if it was not installed
    import_module("gsedit.measures.perceptual").vgg_features.cache_clear()
    result = gsedit("edit", scene, "as gold", "-o", out, "--size", 16, "--features", "vgg")
    assert result.exit_code == 2
    assert "gsedit[perceptual]" in result.stderr
    assert not given


def test_photos_as_the_condition_must_be_named(scene, tmp_path):
    result = gsedit(
        "edit", scene, "make it impressionist", "--condition", "photo", "-o", tmp_path / "out"
    )
    assert result.exit_code == 2
    assert "name them with --data" in result.stderr


def test_the_folder_of_an_edit_is_edited_further(monkeypatch, scene, tmp_path):
    given = stub_edit(monkeypatch)
    folders = [tmp_path / name for name in ("first", "second", "third")]
    words = ("make it impressionist", "impressionist style", "an impressionist painting")
    for source, out, instruction in zip((scene, *folders), folders, words):
        result = gsedit("edit", source, instruction, "-o", out, "--size", 16, "--seed", 5)
        assert result.exit_code == 0, result.stderr
    cameras = json.loads((folders[0] / "cameras.json").read_text())
    assert [view.name for view in given["dataset"].views] == [c["img_name"] for c in cameras]
    records = [json.loads((folder / "edit.json").read_text()) for folder in folders]
    assert [record["first_scene"] for record in records] == [str(scene)] * 3
    assert records[0]["history"] == []
    assert records[1]["history"] == records[2]["history"][:1]
    first, second = records[2]["history"]
    assert (first["instruction"], second["instruction"]) == words[:2]
    assert (first["editor"], first["strategy"]) == ("small", "single-pass")
    assert first["measured"]["rmse_to_unedited"]["edited"]["value"] == 0.1
    assert first["settings_digest"] == second["settings_digest"]

    itself = gsedit("edit", folders[0], "as gold", "-o", folders[0], "-f")
    assert itself.exit_code == 2
    assert "name another" in itself.stderr
    (tmp_path / "ended").mkdir()
    (tmp_path / "ended" / "checkpoint.safetensors").write_bytes(b"")
    ended = gsedit("info", tmp_path / "ended")
    assert ended.exit_code == 2
    assert "gsedit convert" in ended.stderr


def test_an_edit_that_stops_leaves_the_earlier_result_as_it_was(monkeypatch, scene, tmp_path):
    stub_edit(monkeypatch)
    out = tmp_path / "out"
    again = ("edit", scene, "make it impressionist", "-o", out, "--size", 16)
    assert gsedit(*again).exit_code == 0
    own, stale = out / "targets" / "mine" / "own.png", out / "targets" / "earlier.png"
    own.parent.mkdir()
    for file in (own, stale):
        file.write_bytes(b"mine")
    record = json.loads((out / "edit.json").read_text())
    record["pictures"]["targets"] += ["earlier.png", "../scene.ply", "../../scene.ply"]
    before = files(out)
    stub_edit(monkeypatch, end=KeyboardInterrupt())
    assert gsedit(*again, "-f").exit_code == 130
    kept = files(out)
    assert {path: kept[path] for path in before} == before
    assert {path.name for path in set(kept) - set(before)} == {
        "checkpoint.safetensors",
        "metrics.unfinished.jsonl",
    }
    stub_edit(monkeypatch)
    for listed, is_there in ((record, True), ({**record, "pictures": {
        "targets": ["earlier.png"], "held_out": []}}, False)):  # fmt: skip
        (out / "edit.json").write_text(json.dumps(listed))
        assert gsedit(*again, "-f").exit_code == 0
        assert stale.exists() == is_there  # a list that names other files is not followed
        assert own.read_bytes() == b"mine"
        assert scene.exists()
    assert not list(out.glob("*unfinished*"))


def test_of_two_edits_into_one_folder_the_second_is_told(monkeypatch, scene, tmp_path):
    out = tmp_path / "out"
    given = stub_edit(monkeypatch)
    module = import_module("gsedit.editing.edit")
    first, said = module.edit_steps, []

    def edit_steps(*words, **options):
        monkeypatch.setattr(module, "edit_steps", first)
        said.append(gsedit("edit", scene, "impressionist style", "-o", out, "--size", 16, *more))
        yield from first(*words, **options)

    for more in ((), ("-f",)):
        monkeypatch.setattr(module, "edit_steps", edit_steps)
        done = gsedit("edit", scene, "make it impressionist", "-o", out, "--size", 16, *more)
        assert done.exit_code == 0, done.stderr
        assert said[-1].exit_code == 2
        assert "another gsedit is writing" in said[-1].stderr
        assert given["prompt"] == "make it impressionist"


def test_names_follow_each_step_of_a_sentence(monkeypatch, scene, photos, tmp_path):
    stub_edit(monkeypatch)
    means = load(scene).means.numpy()
    save_named(np.arange(5) == 1, means, scene, "hat")
    out = tmp_path / "out"
    words = "make it impressionist and then paint the hat red"
    done = gsedit("edit", scene, words, "--data", photos, "-o", out)
    assert done.exit_code == 0, done.stderr
    for folder in (out / "steps" / "1", out):
        assert np.load(folder / "scene.regions" / "hat.npy").tolist() == [False, True] + [False] * 3
    assert np.load(out / "region.npy").sum() == 1
    words = ("make it impressionist and then paint it red", "--region", "hat")
    done = gsedit("edit", scene, *words, "--data", photos, "-o", out, "-f")
    assert done.exit_code == 0, done.stderr
    region = json.loads((out / "edit.json").read_text())["settings"]["region"]
    assert Path(region) == out / "steps" / "1" / "scene.regions" / "hat.npy"


def test_resume_begins_where_nothing_was_kept(monkeypatch, scene, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "metrics.unfinished.jsonl").write_text("")
    given = stub_edit(monkeypatch)
    result = gsedit("edit", scene, "make it impressionist", "-o", out, "--size", 16, "--resume")
    assert result.exit_code == 0, result.stderr
    assert "the edit begins" in result.stderr
    assert given["resume"] is None


def test_an_edit_goes_on_without_the_checkpoint_that_a_full_disk_takes(
    monkeypatch, scene, tmp_path
):
    def full(*_):
        raise GseditError("checkpoint cannot be written (No space left on device)")

    stub_edit(monkeypatch)
    monkeypatch.setattr("gsedit.runs.state.save_state", full)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it impressionist", "-o", out, "--size", 16)
    assert result.exit_code == 0, result.stderr
    assert result.stderr.count("the work continues without this checkpoint") == 1
    assert (out / "edit.json").exists()


def test_other_threads_are_told(monkeypatch, scene, tmp_path):
    stub_edit(monkeypatch, end=KeyboardInterrupt())
    words = ("edit", scene, "impressionist", "-o", tmp_path / "out", "--size", 16, "--threads")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # so that --threads lasts no longer than the test
    threads = torch.get_num_threads()
    gsedit(*words, 1)
    stub_edit(monkeypatch)
    result = gsedit(*words, 2, "--resume")
    torch.set_num_threads(threads)
    assert "begun on 1 threads and continues on 2" in result.stderr
    assert result.exit_code == 0


def test_the_edited_folder_is_known_by_another_path(scene, tmp_path):
    (tmp_path / "link").symlink_to(scene.parent)
    for out in (tmp_path / "link", tmp_path / "x" / ".."):
        (tmp_path / "x").mkdir(exist_ok=True)
        result = gsedit("edit", scene, "as gold", "-o", out, "-f", "--size", 16)
        assert result.exit_code == 2
        assert "name another" in result.stderr


def test_a_seed_that_no_generator_takes_is_refused(scene, tmp_path):
    for seed in (-1, 1 << 70):
        result = gsedit("edit", scene, "as gold", "-o", tmp_path / "out", "--seed", seed)
        assert result.exit_code == 2
        assert one_line(result.stderr)
