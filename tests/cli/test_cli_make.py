"""`gsedit make`: which stages run, go on and are left alone. What the stages do is stubbed."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from command_line import answer, gsedit
from gsedit_cli.core.command import Seeded
from gsedit_cli.core.exits import Interrupted
from gsedit_cli.verbs import make as verb
from gsedit_cli.verbs.capture import settings_from
from PIL import Image

from gsedit.errors import InputError

LOOK, OTHER = "make it impressionist", "an impressionist painting"


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


def make(photos, out, *more, instruction=LOOK) -> int:
    return gsedit("make", photos, instruction, "-o", out, *more).exit_code


def test_the_stages_run_once(photos, out, stages):
    assert answer("make", photos, LOOK, "-o", out) == {
        "type": "result", "folder": str(out), "dataset": str(out / "capture"),
        "scene": str(out / "scene.ply"), "edited": str(out / "edit/scene.ply"),
    }  # fmt: skip
    assert stages.ran == [("capture", False), ("fit", False), ("edit", False)]
    assert make(photos, out) == 0
    assert len(stages.ran) == 3


@pytest.mark.parametrize("error", [Interrupted("stopped"), KeyboardInterrupt()])
def test_an_interrupted_stage_goes_on_with_the_same_command(photos, out, stages, error):
    stages.end["fit"] = error
    assert make(photos, out) == 130
    assert make(photos, out) == 0
    assert stages.ran[2:] == [("fit", True), ("edit", False)]


def test_photos_may_be_added_after_a_capture_that_failed(photos, out, stages):
    stages.end["capture"] = InputError("too little overlap: take photos in between")
    assert make(photos, out) == 3
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")
    assert make(photos, out) == 0


def test_another_request_replaces_what_follows_from_it_and_only_with_force(photos, out, stages):
    make(photos, out)
    for more, instruction, again in (
        ((), OTHER, ["edit"]), (("--size", 128), OTHER, ["fit", "edit"]),
    ):  # fmt: skip
        stages.ran.clear()
        assert make(photos, out, *more, instruction=instruction) == 2
        assert not stages.ran
        assert make(photos, out, *more, "-f", instruction=instruction) == 0
        assert [name for name, _ in stages.ran] == again
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")
    assert make(photos, out, "--size", 128, instruction=OTHER) == 2
    stages.ran.clear()
    stages.end["fit"] = KeyboardInterrupt()
    assert make(photos, out, "--size", 128, "-f", instruction=OTHER) == 130
    assert make(photos, out, "--size", 128, instruction=OTHER) == 0  # goes on without force
    assert stages.ran == [("capture", False), ("fit", False), ("fit", True), ("edit", False)]
    (out / "scene.ply").unlink()
    stages.ran.clear()
    assert make(photos, out, "--size", 128, instruction=OTHER) == 0
    assert stages.ran == [("fit", False), ("edit", False)]


@pytest.mark.parametrize("posed", [False, True])
def test_only_what_is_read_of_the_photos_counts(photos, out, stages, tmp_path, monkeypatch, posed):
    monkeypatch.chdir(tmp_path)
    if posed:
        (photos / "transforms.json").write_text("{}")
    assert make("photos", ".", "-f") == 0
    assert [name for name, _ in stages.ran] == ["capture", "fit", "edit"][posed:]
    (photos / ".DS_Store").touch()
    assert make("photos", ".") == 0
    Image.new("RGB", (8, 8)).save(photos / "3.jpg")  # it is below the output too
    assert make("photos", ".") == 2


def test_a_damaged_record_is_refused(photos, out, stages):
    make(photos, out)
    (out / "make.json").write_text("[1")
    assert make(photos, out) == 3


@pytest.mark.parametrize("seed", [0, 7, -1, 2**40 + 7])
def test_any_seed_is_one_that_colmap_takes(seed):
    assert settings_from({}, Seeded(seed=seed)).seed == seed % 2**31
