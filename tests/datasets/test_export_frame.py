"""A nerfstudio export with its dataparser_transforms.json: photos are put into its frame."""

from __future__ import annotations

import json
from math import cos, sin

import pytest
import torch
from bad_files import dataset, write

from gsedit import load_dataset
from gsedit.errors import InputError
from gsedit.views.export_frame import in_export_frame

TURN = [[cos(0.3), -sin(0.3), 0.0, 0.4], [sin(0.3), cos(0.3), 0.0, -0.2], [0.0, 0.0, 1.0, 0.7]]
APPLIED = [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.1]]


def square(matrix: list[list[float]]) -> torch.Tensor:
    return torch.tensor([*matrix, [0, 0, 0, 1]], dtype=torch.float64)


@pytest.mark.parametrize("applied", [None, APPLIED])
def test_pictures_stay_the_same(tmp_path, applied):
    """As nerfstudio does: it writes transform @ applied_transform, scale * applied_scale."""
    record = dataset(tmp_path / "photos")
    for i, frame in enumerate(record["frames"]):
        frame["transform_matrix"] = [[1, 0, 0, i], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    transform, scale = square(TURN), 0.5
    if applied:
        record |= {"applied_transform": applied, "applied_scale": 2.0}
        transform, scale = transform @ square(applied), 1.0
    write(tmp_path / "photos", record)
    scene = tmp_path / "splat.ply"
    plain = load_dataset(tmp_path / "photos")
    assert in_export_frame(plain, tmp_path / "photos", scene) is plain
    content = {"transform": transform[:3].tolist(), "scale": scale}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(content))
    moved = in_export_frame(plain, tmp_path / "photos", scene)
    points = torch.tensor([[0.3, 2.2, -4.0], [1.0, 1.5, -2.0]], dtype=torch.float64)
    there = 0.5 * (points @ square(TURN)[:3, :3].T + square(TURN)[:3, 3])
    for before, after in zip(plain.views, moved.views, strict=True):
        xy, depth = before.camera.project(points)
        xy_there, depth_there = after.camera.project(there)
        assert torch.allclose(xy, xy_there)
        assert torch.allclose(depth_there, 0.5 * depth)


@pytest.mark.parametrize(
    "content", ["[]", '{"scale": 1}', json.dumps({"transform": TURN, "scale": 0})]
)
def test_other_files_are_refused(tmp_path, content):
    dataset(tmp_path / "photos")
    (tmp_path / "dataparser_transforms.json").write_text(content)
    plain = load_dataset(tmp_path / "photos")
    with pytest.raises(InputError, match="dataparser_transforms"):
        in_export_frame(plain, tmp_path / "photos", tmp_path / "splat.ply")
