"""The prepared photos, the pairs, and the child process."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from lens_photos import RealLens, take, walk
from PIL import Image

from gsedit.capture import stages, worker
from gsedit.capture.capture import capture_steps
from gsedit.capture.folder import find_photos
from gsedit.capture.photos import Prepared, prepare
from gsedit.capture.settings import FORESTS, CaptureSettings, choose, ranked
from gsedit.capture.stages import Step


def test_photos_are_paired_with_those_that_show_the_same_and_not_with_strangers():
    random = np.random.default_rng(0)

    def ring(count):  # each photo shows 50 features, 40 of which the next one shows too
        features = random.normal(size=(10 * count, 128))
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        return [np.roll(features, -10 * i, 0)[:50] for i in range(count)]

    photos = ring(12) + ring(12)
    common = [[worker._in_common(a, b) for b in photos[:j]] for j, a in enumerate(photos)]
    assert common[1] == [40]
    assert common[11][:3] == [40, 30, 20]
    pairs = choose(common)
    assert {(i, i + 1) for i in range(23) if i != 11} | {(0, 11), (12, 23)} <= pairs
    assert all((i < 12) == (j < 12) for i, j in pairs)
    assert min(Counter(i for pair in pairs for i in pair).values()) >= FORESTS


@pytest.mark.parametrize("forests", [1, 3, 6])
def test_every_group_of_photos_leads_to_the_others_as_often_as_forests_are_asked_for(forests):
    random = np.random.default_rng(forests)
    for count in (2, 5, 17):
        common = random.integers(-9, 9, (count, count)).clip(0).tolist()
        pairs, every = choose(common, forests), ranked(common)
        assert set(every) == {(i, j) for j in range(count) for i in range(j)}
        assert all(common[j][i] for i, j in pairs)
        assert len(pairs) <= forests * (count - 1)
        for group in [*np.eye(count, dtype=bool), *(random.random((50, count)) < 0.5)]:
            leads = [pair for pair in every if group[pair[0]] != group[pair[1]]]
            able = sum(common[j][i] > 0 for i, j in leads)
            assert len(pairs & set(leads)) >= min(forests, able)


def test_photos_without_a_pose_are_matched_with_all_others(tmp_path, monkeypatch):
    """A COLMAP of six photos: it poses those that matches connect; 5 seems to show nothing, and
    matches 0."""
    random, asked = np.random.default_rng(0), []
    (tmp_path / "photos").mkdir()
    for i in range(6):
        noise = random.integers(0, 256, (64, 64), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / "photos" / f"{i}.png")

    def run(task, request, *_):
        yield from ()
        answer = {}
        if task == "features":
            sqlite3.connect(request["database"]).close()
        elif task == "pairs":
            answer = {"common": [[9 * (j < 5)] * j for j in range(6)]}
        elif task == "matches":
            asked.append(Path(request["pairs"]).read_text().splitlines())
            seen = {"inliers": 99, "flat": False, "shift": 1.0}
            pairs = [{"names": line.split(), **seen} for line in asked[-1]]
            answer = {"features": {}, "pairs": pairs}
        elif task == "mapping":
            poses = dict.fromkeys(f"{i}.png" for i in range(5 + ("0.png 5.png" in asked[-1])))
            answer = {"models": [{"folder": "0", "poses": poses, "points": 1}]}
        else:
            raise KeyboardInterrupt
        return answer

    monkeypatch.setattr(stages, "run", run)
    steps = capture_steps(tmp_path / "photos", tmp_path / "scene", CaptureSettings())
    with pytest.raises(KeyboardInterrupt):  # with all six, of the refinement
        list(steps)
    first = [f"{i}.png {j}.png" for i in range(5) for j in range(i + 1, 5)]
    assert asked == [first, sorted([*first, *(f"{i}.png 5.png" for i in range(5))])]


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
