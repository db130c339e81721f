"""`gsedit make`: which stages run, go on and are left alone. What the stages do is stubbed."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from command_line import gsedit, one_line
from gsedit_cli.core.exits import Interrupted
from gsedit_cli.options.common import Seeded
from gsedit_cli.verbs import make as verb
from gsedit_cli.verbs.capture import settings_from
from PIL import Image

from gsedit.errors import InputError

WATERCOLOR = "make it impressionist"


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(3):
        Image.new("RGB", (8, 8)).save(folder / f"{i}.jpg")
    return folder


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


@pytest.fixture
def stages(monkeypatch):
    """Names of the stages that ran, in order; `end` maps a stage to the error that it ends with."""
    ran, end = [], {}

    def stage(name, file, result):
        def run(*places, **options):
            given = [getattr(each, "own", each) for each in places]
            own = next((each for each in given if hasattr(each, "resume")), None)
            ran.append((name, own is not None and own.resume))
            folder = places[1] if own is None else own.out
            if name in end:
                raise end.pop(name)
            path = folder / file if file else folder
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("{}")
            return result

        monkeypatch.setattr(verb, f"run_{name}", run)

    stage("capture", "capture.json", None)
    stage("fit", "", SimpleNamespace(scene=range(1234), psnr=23.456))
    stage("edit", "edit.json", None)

    monkeypatch.setattr(verb, "capture_summary", lambda _: "3 of 3 photos posed\nfocal 26 mm")
    return SimpleNamespace(ran=ran, end=end)


def make(photos, out, *more, instruction=WATERCOLOR):
    return gsedit("make", photos, instruction, "-o", out, *more)


def test_the_stages_run_once_and_the_last_screen_names_what_is_where(photos, out, stages):
    done = make(photos, out)
    assert done.exit_code == 0
    assert stages.ran == [("capture", False), ("fit", False), ("edit", False)]
    assert done.stdout == f"{out / 'edit' / 'scene.ply'}\n"
    for text in (
        "1 of 3, capture: ", f"{out / 'capture'}         3 of 3 photos posed\n",
        "1,234 Gaussians, 23.5 dB on held-out photos", "before_after.png", "next:    gsedit view",
    ):  # fmt: skip
        assert text in done.stderr
    again = make(photos, out)
    assert again.exit_code == 0
    assert len(stages.ran) == 3
    assert again.stderr.count("done before") == 3
    assert "3 of 3 photos posed" in again.stderr


@pytest.mark.parametrize("error", [Interrupted("stopped"), KeyboardInterrupt()])
def test_an_interrupted_stage_goes_on_with_the_same_command(photos, out, stages, error):
    stages.end["fit"] = error
    ended = make(photos, out)
    assert ended.exit_code == 130
    assert "interrupted in the fit; what is done is kept in " in ended.stderr
    assert "the same command continues there" in ended.stderr
    assert make(photos, out).exit_code == 0
    assert stages.ran[2:] == [("fit", True), ("edit", False)]


def test_photos_may_be_added_after_a_capture_that_failed(photos, out, stages):
    stages.end["capture"] = InputError("too little overlap: take photos in between")
    make(photos, out)
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")
    assert make(photos, out).exit_code == 0


def test_another_instruction_replaces_only_the_edit_and_only_with_force(photos, out, stages):
    make(photos, out)
    refused = make(photos, out, instruction="an impressionist painting")
    assert refused.exit_code == 2
    assert one_line(refused.stderr)
    assert "the edit of another request (other instruction): add -f" in refused.stderr
    assert "or edit the same scene into another folder: gsedit edit " in refused.stderr
    assert make(photos, out, "-f", instruction="an impressionist painting").exit_code == 0
    assert stages.ran[3:] == [("edit", False)]


def test_a_replacement_that_was_interrupted_goes_on_without_force(photos, out, stages):
    make(photos, out)
    stages.end["fit"] = KeyboardInterrupt()
    make(photos, out, "--size", 128, "-f", instruction="an impressionist painting")
    assert make(photos, out, "--size", 128, instruction="an impressionist painting").exit_code == 0
    assert stages.ran[3:] == [("fit", False), ("fit", True), ("edit", False)]


def test_other_photos_or_sizes_replace_what_follows_from_them(photos, out, stages):
    make(photos, out)
    refused = make(photos, out, "--size", 128)
    assert refused.exit_code == 2
    assert "the fit of another request (other size): add -f" in refused.stderr
    assert make(photos, out, "--size", 128, "-f").exit_code == 0
    assert [name for name, _ in stages.ran[3:]] == ["fit", "edit"]
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")
    assert "the capture of another request (other photos)" in make(photos, out).stderr
    assert make(photos, out, "--size", 128, "-f").exit_code == 0
    assert [name for name, _ in stages.ran[5:]] == ["capture", "fit", "edit"]


def test_what_follows_from_a_stage_that_ran_again_runs_again(photos, out, stages):
    make(photos, out)
    (out / "scene.ply").unlink()
    assert make(photos, out).exit_code == 0
    assert stages.ran[3:] == [("fit", False), ("edit", False)]


def test_photos_with_poses_are_not_captured(photos, out, stages):
    (photos / "transforms.json").write_text("{}")
    done = make(photos, out)
    assert [name for name, _ in stages.ran] == ["fit", "edit"]
    assert "1 of 2, fit" in done.stderr
    assert f"--data {photos}" in done.stderr


@pytest.mark.parametrize("posed", [False, True])
def test_only_what_is_read_of_the_photos_counts(photos, out, stages, tmp_path, monkeypatch, posed):
    monkeypatch.chdir(tmp_path)
    if posed:
        (photos / "transforms.json").write_text("{}")
    make("photos", ".", "-f")
    (photos / ".DS_Store").touch()
    assert make("photos", ".").exit_code == 0
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")  # it is below the output too
    assert "of another request (other photos)" in make("photos", ".").stderr


def test_a_damaged_record_is_named(photos, out, stages):
    make(photos, out)
    (out / "make.json").write_text("[1")
    refused = make(photos, out)
    assert refused.exit_code == 3
    assert "make.json is damaged: remove it, and add -f" in refused.stderr


@pytest.mark.parametrize("seed", [0, 7, -1, 2**40 + 7])
def test_any_seed_is_one_that_colmap_takes(seed):
    assert settings_from({}, Seeded(seed=seed)).seed == seed % 2**31
