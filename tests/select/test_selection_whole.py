"""Selections that need the whole scene, a mesh or cameras: laws, and known answers."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from splat_tables import random_table

from gsedit import View
from gsedit.errors import InputError, UsageError
from gsedit.scene.neighbors import cluster_labels
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select import Finder
from gsedit.select.kinds import FORMS, grow, middle, shrink
from gsedit.select.selection import Selection
from gsedit.select.values import NAMED
from gsedit.toolkit import filter, select, where
from gsedit.views.cameras_json import read_cameras, write_cameras
from rasterizer import Camera, look_at

CAMERA = {
    "id": 0, "img_name": "front", "width": 64, "height": 64, "position": [0.0, 0.0, -4.0],
    "rotation": np.eye(3).tolist(), "fx": 64.0, "fy": 64.0,
}  # fmt: skip


def at(points: np.ndarray, size: float = 0.1) -> SplatTable:
    """Make an opaque grey ball at each point."""
    n = len(points)
    quats = np.tile(np.float32([1, 0, 0, 0]), (n, 1))
    log_scales = np.full((n, 3), np.log(size), np.float32)
    return SplatTable(
        points.astype(np.float32), quats, log_scales, np.full(n, 5, np.float32),
        np.zeros((n, 1, 3), np.float32),
    )  # fmt: skip


def test_a_kind_and_a_value_are_added_by_their_rows(monkeypatch):
    def beyond(x: float) -> Selection:
        return Selection(lambda table: table.means[:, 0] > x)

    monkeypatch.setitem(FORMS, "beyond", beyond)
    monkeypatch.setitem(NAMED, "twice", ("2 x", lambda table: 2 * table.means[:, 0]))
    for words in ("beyond(0.5)", "twice > 1"):
        assert where(words).mask(at(np.eye(3))).tolist() == [True, False, False]


def linked(points: np.ndarray, gap: float) -> np.ndarray:
    """Clusters by the distances of all pairs."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial.distance import cdist

    return connected_components(cdist(points, points) <= gap)[1]


@pytest.mark.parametrize("gap", [0.02, 0.1, 0.3, 1.0, 5.0])
def test_clusters_are_those_of_all_pairs(gap):
    draw = np.random.default_rng(1)
    points = np.concatenate([
        draw.normal(size=(300, 3)),
        draw.normal(size=(300, 3)) * 0.05 + [2, 0, 0],
        draw.normal(size=(100, 3)) * 1e3,
        np.repeat(draw.normal(size=(20, 3)), 5, axis=0),
    ])  # fmt: skip
    a, b = cluster_labels(points, gap), linked(points, gap)
    pairs = np.unique(np.stack([a, b], 1), axis=0)
    assert len(pairs) == len(np.unique(a)) == len(np.unique(b))


def test_clusters_of_a_grid_are_linked_at_its_step_and_not_below():
    axis = np.arange(6) * 0.25
    points = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3) - 3
    assert cluster_labels(points, 0.25).max() == 0
    assert cluster_labels(points, 0.2499).max() == len(points) - 1


def test_the_largest_cluster_of_a_scene_a_million_wide():
    draw = np.random.default_rng(2)
    body, other = draw.uniform(-1, 1, (500, 3)), draw.uniform((19, -1, -1), (21, 1, 1), (200, 3))
    far = draw.uniform(-1e6, 1e6, size=(300, 3))
    table = at(np.concatenate([body, other, far]))
    expected = np.arange(1000) < 500
    for text in ("cluster(gap=2)", "cluster_at(0, 0, 0, gap=2)"):
        np.testing.assert_array_equal(select(table, text), expected, err_msg=text)
    np.testing.assert_array_equal(select(table, "cluster(2, 2)"), np.arange(1000) < 700)
    only = select(table, "cluster(gap=2, of=x > 10)")
    np.testing.assert_array_equal(only, (np.arange(1000) >= 500) & (np.arange(1000) < 700))
    assert select(table, "cluster()")[:500].mean() > 0.9  # a gap of its own choice
    assert not select(table[:0], "cluster()").any()


def test_grow_and_shrink_by_a_radius():
    draw = np.random.default_rng(3)
    table, inner = at(draw.normal(size=(600, 3))), where("sphere(0, 0, 0, 0.8)")
    inside = inner.mask(table)
    distance = np.linalg.norm(table.means[:, None] - table.means[None], axis=2)
    grown = grow(inner, 0.3).mask(table)
    np.testing.assert_array_equal(grown, (distance[:, inside] <= 0.3).any(1))
    shrunk = shrink(inner, 0.3).mask(table)
    np.testing.assert_array_equal(shrunk, inside & ~(distance[:, ~inside] <= 0.3).any(1))
    assert shrunk.sum() < inside.sum() < grown.sum()
    assert shrink(grow(inner, 0.3), 0.3).mask(table)[inside].all()
    assert not grow(shrink(inner, 0.3), 0.3).mask(table)[~inside].any()
    # the complement grows as the selection shrinks
    np.testing.assert_array_equal(select(table, ~grow(~inner, 0.3)), shrunk)


def test_rows_that_are_not_numbers_are_near_nothing():
    table = at(np.random.default_rng(4).normal(size=(50, 3)))
    table.means[3] = np.nan
    for text in ("grow(x > 0, 0.5)", "shrink(all(), 0.5) and x == x", "cluster(gap=9)"):
        assert not select(table, text)[3], text


def test_inside_a_mesh_of_a_sphere_is_inside_the_sphere(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(subdivisions=4)
    table = at(np.random.default_rng(5).normal(size=(3000, 3)))
    table.means[0] = np.nan
    radius = np.linalg.norm(table.means, axis=1)
    clear = np.abs(radius - 1) > 0.003  # the mesh is within 0.002 of the sphere
    for name in ("ball.ply", "ball.obj", "ball.stl", "ball.glb"):
        path = tmp_path / name
        mesh.export(path)
        inside = select(table, f"inside('{path}')")
        np.testing.assert_array_equal(inside[clear], (radius < 1)[clear], err_msg=name)
        assert not inside[0]


def test_a_mesh_with_a_hole_and_no_mesh_are_refused(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere()
    trimesh.Trimesh(mesh.vertices, mesh.faces[1:]).export(tmp_path / "open.ply")
    trimesh.PointCloud(mesh.vertices).export(tmp_path / "points.ply")
    (tmp_path / "text.ply").write_text("ply\nnonsense")
    (tmp_path / "text.obj").write_text("nonsense")
    (tmp_path / "text.doc").write_text("nonsense")
    for name, message in (
        ("open.ply", "no closed mesh"),
        ("points.ply", "no"),
        ("text.ply", "cannot be read as a mesh"),
        ("text.obj", "no"),
        ("text.doc", "cannot be read as a mesh"),
    ):
        with pytest.raises(InputError, match=message):
            select(at(np.zeros((2, 3))), f"inside('{tmp_path / name}')")
    with pytest.raises(InputError, match="missing"):
        select(at(np.zeros((2, 3))), f"inside('{tmp_path / 'missing.ply'}')")


def test_seen_is_what_is_in_the_picture_and_not_hidden(tmp_path):
    cameras = tmp_path / "cameras.json"
    cameras.write_text(json.dumps([CAMERA]))
    wall = np.stack([*np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))], -1)
    wall = np.concatenate([wall.reshape(-1, 2), np.zeros((441, 1))], 1)
    behind, aside = [[0.0, 0.0, 2.0]], [[9.0, 0.0, 0.0]]
    table = at(np.concatenate([wall, behind, aside]))
    inside = select(table, f"seen('{cameras}', 0.1)")
    assert inside.tolist() == [True] * 441 + [False, False]
    alone = select(table[-2:], f"seen('{tmp_path}')")
    assert alone.tolist() == [True, False]


def test_masks_drawn_on_renders_select_what_is_behind_them(tmp_path):
    from PIL import Image

    cameras = tmp_path / "cameras.json"
    cameras.write_text(json.dumps([CAMERA]))
    left = np.zeros((64, 64), np.uint8)
    left[:, :32] = 255
    Image.fromarray(left).save(tmp_path / "000_front.png")
    draw = np.random.default_rng(6)
    points = np.concatenate([draw.normal(size=(40, 3)) * 0.1 + [s, 0, 0] for s in (-1, 1)])
    table = at(points, 0.05)
    finder = Finder(gaussians_of(table), read_cameras(cameras))
    found = finder.select(str(tmp_path))
    assert found.how == f"mask('{tmp_path}')"
    assert found.inside.tolist() == [True] * 40 + [False] * 40


# ---- the part of a scene that its cameras stand around ------------------------------------------

MIDDLE = torch.tensor([1.0, -2.0, 0.5])


def ring(count: int = 8, radius: float = 4.0) -> list[Camera]:
    """Cameras on a circle, which look at MIDDLE."""
    up = torch.tensor([0.0, -1.0, 0.0])
    angles = torch.arange(count) * 2 * torch.pi / count
    eyes = [MIDDLE + radius * torch.tensor([a.cos(), -0.4, a.sin()]) for a in angles]
    return [look_at(eye, MIDDLE, up, 1.0, 32, 32) for eye in eyes]


@pytest.fixture
def cameras(tmp_path):
    path = tmp_path / "cameras.json"
    picture = torch.zeros(32, 32, 3)
    write_cameras([View(str(i), c, picture) for i, c in enumerate(ring())], path)
    return path


def test_cameras_that_look_in_parallel_have_no_middle(tmp_path):
    poses = [{**CAMERA, "id": i, "position": [i, 0.0, -4.0]} for i in range(3)]
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(poses))
    with pytest.raises(UsageError, match="no common point"):
        select(random_table(5), middle(0.5, str(path)))


def test_what_is_near_that_point_stays(cameras):
    table = random_table(500)
    away = np.linalg.norm(table.means - MIDDLE.numpy(), axis=1)
    kept = filter(table, middle(0.5, str(cameras)))
    near = away <= 0.5 * 4 * np.sqrt(1.16)
    assert 0 < near.sum() < 500
    np.testing.assert_array_equal(kept.means, table.means[near])
