"""MP4, GIF and WebP: what comes back, and nothing left of what was interrupted."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from videos import read_frames

from gsedit import write_loop, write_mp4
from gsedit.errors import UsageError


def frames(count: int = 6, height: int = 48, width: int = 64) -> list[np.ndarray]:
    """Smooth waves that move."""
    y, x = np.mgrid[0:height, 0:width]
    return [
        np.stack([127 + 90 * np.sin(x / 12 + i / 4), 127 + 90 * np.cos(y / 9), 60 + x], -1)
        .clip(0, 255)
        .astype(np.uint8)
        for i in range(count)
    ]


def test_an_mp4_shows_every_frame_in_its_colors(tmp_path):
    pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    write_mp4(iter(frames()), path, 12.5)
    found = list(read_frames(path))
    assert len(found) == 6
    error = np.stack(found).astype(float) - np.stack(frames())
    assert (error**2).mean() < 255**2 * 10 ** (-36 / 10)  # 36 dB
    assert np.abs(error.mean((0, 1, 2))).max() < 2  # the matrix and range are the right ones
    better = tmp_path / "b.mp4"
    write_mp4(frames(), better, 12.5, crf=4)
    error = np.stack(list(read_frames(better))).astype(float) - np.stack(frames())
    assert (error**2).mean() < 255**2 * 10 ** (-40 / 10)
    import av

    with av.open(str(path)) as container:
        assert float(container.streams.video[0].average_rate) == 12.5


@pytest.mark.parametrize(("name", "lengths"), [("a.gif", {30, 40}), ("a.webp", {33, 34})])
def test_a_loop_repeats_and_keeps_its_pace(name, lengths, tmp_path):
    path = tmp_path / name
    write_loop(iter(frames(7)), path, 30.0)
    with Image.open(path) as picture:
        assert picture.info["loop"] == 0
        assert picture.n_frames == 7
        times = []
        for i, expected in enumerate(frames(7)):
            picture.seek(i)
            picture.load()
            times.append(picture.info["duration"])
            error = np.asarray(picture.convert("RGB")).astype(float) - expected
            assert np.sqrt((error**2).mean()) < 5
    assert sum(times) == pytest.approx(7000 / 30, abs=5)  # a GIF's are in hundredths
    assert set(times) == lengths


@pytest.mark.parametrize("name", ["a.mp4", "a.gif", "a.webp"])
def test_an_interrupted_animation_leaves_nothing(name, tmp_path):
    write = write_mp4 if name == "a.mp4" else write_loop
    if write is write_mp4:
        pytest.importorskip("av")

    def broken():
        yield from frames(3)
        raise KeyboardInterrupt

    (tmp_path / name).write_text("an older one")
    with pytest.raises(KeyboardInterrupt):
        write(broken(), tmp_path / name, 10.0, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "an older one"
    with pytest.raises(UsageError, match="already exists"):
        write(iter(frames(2)), tmp_path / name, 10.0)
    with pytest.raises(UsageError, match="no frames"):
        write([], tmp_path / f"none_{name}", 10.0)
