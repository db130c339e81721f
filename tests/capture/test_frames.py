"""Frames of videos: which are taken, how they are written, and how bad videos end."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from gsedit.capture.frames import Extraction, extract_steps
from gsedit.errors import InputError

pytest.importorskip("av", reason="needs PyAV: pip install 'gsedit[video]'")
from videos import SIZE, passing, texture, write_video


def indices(paths) -> list[int]:
    return [int(path.stem.removeprefix("frame_")) for path in paths]


def extraction(video, folder, count=None) -> Extraction:
    *_, last = extract_steps(video, folder, count)
    return last


def extract(video, folder, count=None):
    return extraction(video, folder, count).paths


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Six seconds; of every five frames three are blurred."""
    blurred = [i for i in range(60) if i % 5 not in (1, 3)]
    frames = passing(range(0, 360, 6), blurred)
    return write_video(tmp_path_factory.mktemp("walk") / "walk.mp4", frames)


def test_each_stretch_gives_its_sharpest_frame(walk, tmp_path):
    found = extraction(walk, tmp_path, 12)
    paths = found.paths
    assert len(paths) == 12
    assert not found.notes
    assert list(paths) == sorted(paths)
    assert all(i % 5 in (1, 3) for i in indices(paths))
    assert set(np.array(indices(paths)) // 5) == set(range(12))
    assert {Image.open(path).size for path in paths} == {SIZE}


def test_a_written_frame_is_the_frame_of_the_video(tmp_path):
    frames = passing(range(0, 120, 6))
    path = extract(write_video(tmp_path / "v.mp4", frames), tmp_path / "out", 5)[2]
    written = np.asarray(Image.open(path)).astype(float)
    differences = [np.abs(written - frame).mean() for frame in frames]
    assert np.argmin(differences) == indices([path])[0]
    assert min(differences) < 4


def test_a_still_passage_is_taken_once(tmp_path):
    offsets = [*range(0, 120, 6), *([120] * 40), *range(120, 240, 6)]
    found = extraction(write_video(tmp_path / "v.mp4", passing(offsets)), tmp_path / "out", 10)
    inside = [i for i in indices(found.paths) if 22 <= i < 58]
    assert len(inside) <= 2
    assert len(found.paths) >= 9


def test_a_variable_frame_rate_is_sampled_by_time(tmp_path):
    # thirty frames in the first second, then ten a second; the wall passes at one speed
    times = [i / 30 for i in range(30)] + [1 + i / 10 for i in range(40)]
    frames = passing([round(60 * at) for at in times])
    found = extraction(write_video(tmp_path / "v.mp4", frames, times=times), tmp_path / "out", 10)
    seconds = [frame.seconds for frame in found.frames]
    assert sum(at < 1 for at in seconds) in (2, 3)
    assert np.diff(seconds).max() < 1.0


@pytest.mark.parametrize("turn", [90, -90, 180])
def test_the_rotation_of_the_metadata_is_applied(tmp_path, turn):
    frames = passing(range(0, 120, 6))
    path = extract(write_video(tmp_path / "v.mp4", frames, turn=turn), tmp_path / "out", 4)[0]
    picture = Image.open(path)
    assert picture.size == (SIZE if turn == 180 else SIZE[::-1])
    upright = np.rot90(frames[indices([path])[0]], turn // 90)
    assert np.abs(np.asarray(picture).astype(float) - upright).mean() < 4


def test_a_video_that_is_cut_off_gives_what_it_has_and_says_so(walk, tmp_path):
    data = walk.read_bytes()
    short = tmp_path / "short.mp4"
    short.write_bytes(data[: len(data) // 2])
    found = extraction(short, tmp_path / "out", 12)
    assert len(found.paths) >= 4
    assert "short.mp4 is cut off: " in found.notes[0]
    assert " of 6.0 s can be decoded" in found.notes[0]


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([np.zeros((64, 96, 3), np.uint8)] * 20, "is black from beginning to end"),
        ([np.full((64, 96, 3), 200, np.uint8)] * 20, "shows one plain color"),
        ([np.asarray(texture().crop((0, 0, 96, 64)))] * 20, "shows one still picture"),
    ],
)
def test_videos_that_show_nothing_are_refused_by_cause(tmp_path, frames, message):
    with pytest.raises(InputError, match=message):
        extract(write_video(tmp_path / "v.mp4", frames), tmp_path / "out")
    assert not list(tmp_path.glob("out/*.jpg"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read .No such file"),
        (b"", "is empty .0 bytes.: copy"),
        (b"\0\0\0\x18ftypmp42", "is cut off: its index"),
        (b"ffconcat version 1.0\nfile a.mp4\n", "is no video that can be read"),
        (b"#EXTM3U\n#EXTINF:1,\na.ts\n#EXT-X-ENDLIST\n", "is no video that can be read"),
        (b"no video" * 100, "is no video that can be read"),
    ],
)
def test_files_that_are_no_videos_are_named(tmp_path, content, message):
    path = tmp_path / "v.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        extract(path, tmp_path / "out")
