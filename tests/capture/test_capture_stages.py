"""The prepared photos, the pairs, the ladder, and the child process."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from lens_photos import RealLens, take, walk
from PIL import Image

from gsedit.capture import stages
from gsedit.capture.folder import find_photos
from gsedit.capture.photos import Prepared, prepare
from gsedit.capture.settings import exhaustive, sequential
from gsedit.capture.stages import Step


@pytest.mark.parametrize("count", [2, 5, 40])
def test_pairs(count):
    assert set(exhaustive(count)) == {(i, j) for j in range(count) for i in range(j)}
    near = sequential(count, overlap=3)
    assert len(set(near)) == len(near)
    assert all(0 <= i < j < count for i, j in near)
    assert {(i, (i + 1)) for i in range(count - 1)} | {(0, count - 1)} <= set(near)  # closed
    assert min(Counter(i for pair in near for i in pair).values()) >= min(count - 1, 6)
    assert max((j - i for i, j in near), default=0) >= count // 4  # and reaches across


def prepared(folder, place, size=1600) -> Prepared:
    (*_, last) = prepare(find_photos(folder, place).files, place, size, folder)
    assert isinstance(last, Prepared)
    return last


def test_photos_are_made_upright_small_and_8_bit(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    ramp = np.tile(np.linspace(0, 255, 200, dtype=np.uint8), (100, 1))
    picture = Image.fromarray(ramp).convert("RGB")
    picture.save(folder / "img 10.JPG", quality=95)
    exif = Image.Exif()
    exif[0x0112] = 6  # shown a quarter turn clockwise
    picture.save(folder / "img 2.jpg", exif=exif, quality=95)
    Image.fromarray(ramp.astype(np.uint16) * 257).save(folder / "img 3.png")
    Image.fromarray(ramp.astype(np.uint16) * 128).save(folder / "img 5.png")
    clear = Image.new("RGBA", (200, 100), (255, 0, 0, 0))
    clear.save(folder / "img 4.png")
    picture.convert("CMYK").save(folder / "img_2.tif")
    found = prepared(folder, tmp_path / "out")
    assert [photo.name for photo in found.photos] == [
        "img_2.jpg", "img_3.png", "img_4.png", "img_5.png", "img_10.JPG", "img_2_tif.jpg",
    ]  # fmt: skip
    assert (found.photos[0].width, found.photos[0].height) == (100, 200)
    for photo in found.photos:
        with Image.open(tmp_path / "out" / photo.name) as written:
            assert written.mode == "RGB"
            assert written.size == (photo.width, photo.height)
            values = np.asarray(written, dtype=float)
        if photo.name == "img_2.jpg":
            values = np.rot90(values)
        expected = np.full((100, 200), 255.0) if photo.name == "img_4.png" else ramp
        if photo.name == "img_5.png":  # half as bright
            expected = ramp * (128 / 257)
        assert np.abs(values - expected[..., None]).max() < 12
    small = prepared(folder, tmp_path / "small", size=100)
    assert {max(photo.width, photo.height) for photo in small.photos} == {100}


def test_the_child_does_not_load_torch():
    code = "import sys, gsedit.capture.worker; sys.exit('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == 0


@pytest.fixture
def request_for_features(tmp_path):
    take(tmp_path / "photos", walk(4), RealLens(120, 120, 100.0))
    names = sorted(path.name for path in (tmp_path / "photos").iterdir())

    def request(count):
        group = {"names": names[:count], "model": "RADIAL", "params": [100.0, 60, 60, 0, 0]}
        return {
            "database": str(tmp_path / "features.db"), "images": str(tmp_path / "photos"),
            "groups": [group], "features": 300, "peak": 0.0067, "affine": False, "size": 200,
            "threads": 1,
        }  # fmt: skip

    return request


def test_features_go_on_in_a_database_with_the_same_camera(request_for_features, tmp_path):
    log = tmp_path / "log"
    for count in (2, 4):
        list(stages.run("features", request_for_features(count), log))
    assert stages.rows(tmp_path / "features.db", "keypoints") == 4
    copy = tmp_path / "copy.db"
    stages.copy_database(tmp_path / "features.db", copy)
    connection = sqlite3.connect(copy)
    ((cameras,),) = connection.execute("SELECT COUNT(*) FROM cameras")
    used = connection.execute("SELECT DISTINCT camera_id FROM images").fetchall()
    connection.close()
    assert cameras == len(used) == 1
    assert "features" in log.read_text()


def test_closing_ends_the_child(tmp_path, monkeypatch):
    started = []
    popen = subprocess.Popen

    def start(_, **options):  # one that says nothing, and ends after this test
        started.append(popen([sys.executable, "-c", "import time; time.sleep(60)"], **options))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", start)
    steps = stages.run("features", {}, tmp_path / "log", lambda: Step(0, 4))
    assert next(steps) == Step(0, 4)
    assert started[0].poll() is None
    steps.close()
    assert started[0].poll() is not None
