"""`gsedit edit`: its folder, its options, interruption."""

from __future__ import annotations

import json
import sys
from importlib import import_module

import pytest
from command_line import files, gsedit, stub_checkpoint

from gsedit.diffusion import SamplerSettings
from gsedit.regions.region import everything
from gsedit.reports.events import Event
from gsedit.reports.journal import read_events


def stub_edit(monkeypatch, *, end: BaseException | None = None):
    from gsedit.session.quality import EditQuality
    from gsedit.session.result import EditResult
    from gsedit.session.session import Work
    from gsedit.views.plan import ViewPlan

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
            plan=ViewPlan(((0,),), (1.0,)),
            region=everything(scene),
            quality=EditQuality(0.5, (("a", "b", 0.5),), 1.0, 0.1, float("inf"), None),
            work=Work(),
            timings={"total": 2.0},
            events=(update, measure),
        )

    monkeypatch.setattr(import_module("gsedit.edit"), "edit_steps", edit_steps)
    return given


def test_edit_leaves_the_scene_and_its_evidence(monkeypatch, scene, photos, tmp_path):
    given = stub_edit(monkeypatch)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it snow", "--data", photos, "-o", out, "--rounds", 1)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip() == str(out / "scene.ply")
    names = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png", "error_vs_time.png"}
    names |= {"cameras.json", "views.json", "region.npy"}
    names |= {"targets/images/0.png", "targets/images/1.png", "targets/images/2.png"}
    assert {path.relative_to(out).as_posix() for path in files(out)} == names
    assert [event.stage for event in read_events(out / "metrics.jsonl")] == ["update", "measure"]
    record = json.loads((out / "edit.json").read_text())
    assert record["instruction"] == given["prompt"] == "make it snow"
    assert record["settings"]["rounds"] == 1
    assert record["settings"]["sampler"]["steps"] == SamplerSettings().steps
    assert record["measured"]["residual_to_targets_db"] is None  # JSON has no infinity
    assert set(record) >= {"seed", "versions", "threads", "timings", "platform", "python"}
    assert gsedit("edit", scene, "make it snow", "-o", out).exit_code == 2


def test_an_interrupted_edit_keeps_its_metrics_and_checkpoint(monkeypatch, scene, tmp_path):
    stub_edit(monkeypatch, end=KeyboardInterrupt())
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it snow", "-o", out, "--size", 16)
    assert result.exit_code == 130
    assert f"{out / 'checkpoint.safetensors'} (step 1)" in result.stderr
    assert "--resume" in result.stderr
    assert {path.name for path in files(out)} == {"checkpoint.safetensors", "metrics.jsonl"}
    assert len(read_events(out / "metrics.jsonl")) == 1

    again = ("edit", scene, "make it snow", "-o", out, "--size", 16)
    asked = gsedit(*again)
    assert asked.exit_code == 2
    assert "add --resume to go on from it, or -f to start again" in asked.stderr
    given = stub_edit(monkeypatch)
    other = gsedit(*again, "--resume", "--editor", "closed-form")
    assert other.exit_code == 2
    assert "editor.editor is closed-form, was small" in other.stderr
    assert gsedit(*again, "--resume").exit_code == 0
    assert given["resume"].record["source"]["scene"] == str(scene)
    assert not (out / "checkpoint.safetensors").exists()
    finished = gsedit(*again, "--resume")
    assert finished.exit_code == 2
    assert "leave --resume out" in finished.stderr


@pytest.mark.parametrize("left", [(), ("metrics.jsonl",), ("metrics.jsonl", ".0123abcd.scene.ply")])
def test_a_run_that_kept_nothing_is_repeated_without_force(monkeypatch, scene, tmp_path, left):
    out = tmp_path / "out"
    out.mkdir()
    for name in left:
        (out / name).write_text("")
    stub_edit(monkeypatch)
    assert gsedit("edit", scene, "make it snow", "-o", out, "--size", 16).exit_code == 0
    assert {path.name for path in files(out)} >= {"scene.ply", "edit.json"}


def test_a_program_that_failed_does_not_stop_the_next_edit(scene, tmp_path):
    out = tmp_path / "out"
    run = f"{sys.executable} -c 'raise SystemExit(3)' {{input}} {{output}}"
    again = ("edit", scene, "as gold", "-o", out, "--size", 16, "--editor", "command", "--run", run)
    for _ in range(2):
        failed = gsedit(*again)
        assert failed.exit_code == 1
        assert "it said nothing" in failed.stderr
    assert {path.name for path in out.iterdir()} == {"command", "metrics.jsonl"}


def test_the_features_of_the_gram_loss_are_named(monkeypatch, scene, tmp_path):
    given = stub_edit(monkeypatch)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "as gold", "-o", out, "--size", 16, "--features", "gone.pth")
    assert result.exit_code == 3
    assert "gone.pth: no such file" in result.stderr
    monkeypatch.setattr("gsedit.measures.perceptual.PACKAGE", "no_such_package")
    import_module("gsedit.measures.perceptual").vgg_features.cache_clear()
    result = gsedit("edit", scene, "as gold", "-o", out, "--size", 16, "--features", "vgg")
    assert result.exit_code == 2
    assert "gsedit[perceptual]" in result.stderr
    assert not given


def test_photos_as_the_condition_must_be_named(scene, tmp_path):
    result = gsedit("edit", scene, "make it snow", "--condition", "photo", "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert "name them with --data" in result.stderr


def test_the_folder_of_an_edit_is_edited_further(monkeypatch, scene, tmp_path):
    given = stub_edit(monkeypatch)
    folders = [tmp_path / name for name in ("first", "second", "third")]
    words = ("make it snow", "as gold", "as bronze")
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
    assert first["measured"]["strength"] == 0.1
    assert first["settings_digest"] == second["settings_digest"]

    itself = gsedit("edit", folders[0], "as gold", "-o", folders[0], "-f")
    assert itself.exit_code == 2
    assert "name another" in itself.stderr
    (tmp_path / "ended").mkdir()
    (tmp_path / "ended" / "checkpoint.safetensors").write_bytes(b"")
    ended = gsedit("info", tmp_path / "ended")
    assert ended.exit_code == 2
    assert "gsedit recover" in ended.stderr
