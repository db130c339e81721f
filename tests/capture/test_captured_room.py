"""Photos through a real lens, without poses: what a capture finds, writes and keeps."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import files, gsedit
from PIL import Image

from gsedit import load_dataset
from gsedit.capture import stages
from gsedit.views.cameras_json import read_cameras

FEW = "--set", "features=600", "--size", 192


def poses(folder):
    """World-to-camera matrices of a dataset by the stem of the photo's name."""
    views = load_dataset(folder, size=16).views
    return {Path(v.name).stem: v.camera.world_to_camera.double().numpy() for v in views}


def pose_error(found, known):
    """Medians over photos: distance of the centers, in the median distance of the known ones from
    their mean, and degrees between axes, when the best similarity has brought the centers together.
    """
    names = sorted(set(found) & set(known))
    a, b = (np.stack([np.linalg.inv(poses[name]) for name in names]) for poses in (found, known))
    from_a, from_b = (x[:, :3, 3] - x[:, :3, 3].mean(0) for x in (a, b))
    u, s, vt = np.linalg.svd(from_b.T @ from_a)  # Umeyama 1991
    turn = np.diag([1, 1, np.linalg.det(u @ vt)])
    rotation = u @ turn @ vt
    scale = (s @ np.diag(turn)) / (from_a**2).sum()
    distance = np.linalg.norm(from_b - scale * from_a @ rotation.T, axis=1)
    left = np.swapaxes(b[:, :3, :3], 1, 2) @ rotation @ a[:, :3, :3]
    cosine = (np.trace(left, axis1=1, axis2=2) - 1) / 2
    center = np.median(distance) / np.median(np.linalg.norm(from_b, axis=1))
    return center, np.median(np.degrees(np.arccos(cosine.clip(-1, 1))))


def test_all_photos_are_posed_where_they_were_taken(captured):
    assert captured.record["posed"] == captured.record["photos"] == 12
    found = poses(captured.scene)
    assert set(found) == set(captured.known)
    center, degrees = pose_error(found, captured.known)
    # other features, as another processor finds them, move the centers by 0.003
    assert center < 0.01
    assert degrees < 0.3
    ((focal, source),) = captured.record["focals"]  # to a tenth of a millimeter
    assert focal == pytest.approx(0.8 * 43.267 / np.sqrt(2), rel=0.02)
    assert source == "guessed"
    assert captured.record["error"] < 0.5


def test_the_world_is_upright(captured):
    found = poses(captured.scene)
    up = [np.linalg.inv(captured.known[name])[:3, :3] for name in found]
    world_up = [np.linalg.inv(found[name])[:3, :3] @ known.T @ (0, 0, 1)
                for name, known in zip(found, up)]  # fmt: skip
    assert np.median(np.array(world_up) @ (0, -1, 0)) > np.cos(np.radians(2))


def test_the_folder_is_a_dataset_with_cameras_and_a_picture(captured):
    data = load_dataset(captured.scene, size=64)
    assert len(data) == 12
    assert data.points is not None
    assert len(data.points) == captured.record["points"] > 1000
    cameras = read_cameras(captured.scene / "cameras.json")
    assert [camera.name for camera in cameras] == [view.name for view in data.views]
    for path in (captured.scene / "images").iterdir():  # undistorted, the corners reach outwards
        with Image.open(path) as picture:
            assert max(picture.size) <= 192
    with Image.open(captured.scene / "capture.png") as picture:
        assert np.asarray(picture).std() > 10
    record = json.loads((captured.scene / "capture.json").read_text())
    assert record == {k: v for k, v in captured.record.items() if k != "type"}


def test_a_second_run_does_nothing_again(captured, monkeypatch):
    before = files(captured.scene)
    monkeypatch.setattr(stages, "run", None)  # would raise
    again = gsedit("capture", captured.photos, "-o", captured.scene, *FEW)
    assert again.exit_code == 0, again.stderr
    after = files(captured.scene)
    assert {p for p in after if after[p] != before.get(p)} <= {captured.scene / "capture.json"}
    assert set(after) == set(before)


def test_what_changes_is_done_again_and_no_more(captured, monkeypatch, tmp_path):
    scene, photos = tmp_path / "scene", tmp_path / "photos"
    shutil.copytree(captured.scene, scene)
    asked = []

    def run(task, *_):
        asked.append(task)
        raise KeyboardInterrupt

    monkeypatch.setattr(stages, "run", run)
    for each in (scene / "work").glob("results-*.json"):  # as where their writing was interrupted
        each.unlink()
    for words in ([], ["--seed", 1], ["--lens", "opencv"]):
        result = gsedit("capture", captured.photos, "-o", scene, *FEW, *words)
        assert result.exit_code == 130
        assert f"kept in {scene / 'work'}: go on with the same command" in result.stderr
    shutil.copytree(captured.photos, photos)
    (photos / "photo_03.jpg").unlink()
    gsedit("capture", photos, "-o", scene, *FEW)
    gsedit("capture", captured.photos, "-o", scene, *FEW, "-f")
    assert asked == ["undistortion", "matches", "features", "features", "features"]
    assert not (scene / "images").exists()  # -f began anew
