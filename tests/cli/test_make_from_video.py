"""A video of a room goes through `gsedit make` to an edited scene, with one command."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from command_line import gsedit
from gsedit_cli.verbs import make as verb
from gsedit_cli.verbs.capture import settings_from
from lens_photos import RealLens, Room, walk
from PIL import Image
from videos import write_video

from gsedit.capture import picture
from gsedit.errors import GseditError

pytest.importorskip("av", reason="needs PyAV: pip install 'gsedit[video]'")


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A short walk around the box; of two frames at each place, the second is blurred."""
    room, lens = Room(), RealLens(224, 224, 0.8 * 224)
    frames = []
    for pose in walk(8, degrees=112):
        picture = room.photo(pose, lens)
        shaken = np.mean([np.roll(picture, shift, 1) for shift in range(6)], 0)
        frames += [picture, shaken.astype(np.uint8)]
    return write_video(tmp_path_factory.mktemp("video") / "walk.mp4", frames)


def no_opengl():
    raise GseditError("no OpenGL")


def test_a_video_becomes_an_edited_scene(video, tmp_path, monkeypatch):
    few = {
        ("sampler", "steps"): 2, ("strategy", "update_steps"): 2, ("batches",): 1,
        ("held_out_edits",): 0,
    }  # fmt: skip
    run_edit = verb.run_edit
    monkeypatch.setattr(verb, "run_edit", lambda asked: run_edit(replace(asked, values=few)))
    monkeypatch.setattr(picture, "check_drawing", no_opengl)
    settings = partial(replace, features=800)  # of capture; every second counts in a test
    monkeypatch.setattr(verb, "settings_from", lambda *a: settings(settings_from(*a)))
    out = tmp_path / "out"
    words = "make", video, "as a woodcut", "-o", out, "--size", 48
    done = gsedit(*words, "--minutes", 0.02, "--frames", 8)
    assert done.exit_code == 0, done.stderr
    assert "8 of 8 photos posed" in done.stderr
    assert "capture.png is not drawn: no OpenGL" in done.stderr  # and the work went on
    for name in ("scene.ply", "edit/scene.ply", "edit/before_after.png"):
        assert (out / name).is_file(), name
    names = sorted(path.stem for path in (out / "capture" / "images").iterdir())
    assert [int(name.removeprefix("frame_")) % 2 for name in names] == [0] * 8  # the sharp ones
    before = np.asarray(Image.open(out / "edit" / "before_after.png"))
    assert before.std() > 10
    again = gsedit(*words, "--minutes", 0.02, "--frames", 8)
    assert again.exit_code == 0
    assert again.stderr.count("done before") == 3
