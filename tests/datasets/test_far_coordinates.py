"""Georeferenced captures are moved to the origin in float64, and the way back is written."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from bad_files import dataset, write
from photo_sets import cameras, opengl_camera_to_world

from gsedit import load_dataset
from gsedit.views.export_frame import (
    NAME,
    frame_beside,
    in_export_frame,
    read_dataparser,
    write_export_frame,
)

UTM = torch.tensor([499871.25, 5412345.5, 312.125], dtype=torch.float64)
HEAD = "ply\nformat ascii 1.0\nelement vertex 1\n"
HEAD += "".join(f"property double {c}\n" for c in "xyz") + "end_header\n"


def far_dataset(folder, offset=UTM, **more):
    record = dataset(folder) | more
    for frame, camera in zip(record["frames"], cameras()):
        pose = torch.tensor(opengl_camera_to_world(camera), dtype=torch.float64)
        pose[:3, 3] += offset
        frame["transform_matrix"] = pose.tolist()
    point = offset + torch.tensor([0.1, 0.2, 0.3])
    (folder / "points3D.ply").write_text(HEAD + " ".join(map(repr, point.tolist())) + "\n")
    return write(folder, record)


def test_a_far_capture_is_moved_and_loses_nothing(tmp_path):
    data = load_dataset(far_dataset(tmp_path))
    offset = torch.tensor(data.offset, dtype=torch.float64)
    assert torch.equal(offset, offset.round())
    assert (offset - UTM).abs().max() < 10
    for view, camera in zip(data.views, cameras()):
        # of 5e6, float64 keeps 1e-9
        torch.testing.assert_close(
            view.camera.center + offset, camera.center + UTM, atol=2e-9, rtol=0
        )
        torch.testing.assert_close(view.camera.rotation, camera.rotation)
        there = torch.tensor([[0.1, 0.2, 0.3]], dtype=torch.float64) + UTM
        assert data.points is not None
        xy, _ = view.camera.project(data.points.double())
        near = replace(view.camera, world_to_camera=camera.world_to_camera)
        expected, _ = near.project(there - UTM)
        torch.testing.assert_close(xy, expected, atol=1e-4, rtol=0)  # points are float32
    (note,) = data.notes
    assert "far from the origin" in note
    assert f"({offset[0]:g}, {offset[1]:g}, {offset[2]:g})" in note


def test_a_capture_near_the_origin_is_not_moved(tmp_path):
    data = load_dataset(far_dataset(tmp_path, torch.tensor([20.0, -10.0, 0.0]).double()))
    assert (data.offset, data.notes) == ((0.0, 0.0, 0.0), ())


APPLIED = [[0.0, 1.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.1]]


@pytest.mark.parametrize(
    "applied",
    [{}, {"applied_transform": APPLIED}, {"applied_transform": APPLIED, "applied_scale": 2.0}],
)
def test_the_way_back_is_beside_the_scene(applied, tmp_path):
    """A scene that is fitted in the moved frame meets the photos again, and the files' frame."""
    folder = far_dataset(tmp_path / "photos", **applied)
    data, scene = load_dataset(folder), tmp_path / "scene.ply"
    assert write_export_frame(frame_beside(data, folder, scene), scene) == tmp_path / NAME
    again = in_export_frame(load_dataset(folder), folder, scene)
    for a, b in zip(data.views, again.views, strict=True):
        torch.testing.assert_close(
            a.camera.world_to_camera, b.camera.world_to_camera, atol=1e-8, rtol=0
        )
    if "applied_scale" in applied:  # nerfstudio's own file does not say where it was applied
        return
    change = read_dataparser(tmp_path / NAME)
    center = data.views[1].camera.center.numpy()
    original = change.inverse.points(center[None])[0]  # before the applied transform
    if applied:
        square = np.concatenate((np.array(APPLIED), [[0, 0, 0, 1.0]]))
        original = (square @ np.append(original, 1))[:3]
    there = list(cameras())[1].center + UTM
    torch.testing.assert_close(torch.from_numpy(original), there, atol=1e-8, rtol=0)


def test_a_scene_of_another_program_is_in_the_frame_of_the_files(tmp_path):
    folder = far_dataset(tmp_path / "photos")
    data = in_export_frame(load_dataset(folder), folder, tmp_path / "scene.ply")
    torch.testing.assert_close(
        data.views[0].camera.center, next(iter(cameras())).center + UTM, atol=2e-9, rtol=0
    )
