"""Meshes of scenes: laws, exact surfaces, and files."""

from __future__ import annotations

import json
from dataclasses import replace
from math import log, pi

import numpy as np
import pytest
import torch
from command_line import gsedit
from small_scenes import scenes

from gsedit import load, save
from gsedit.bench.synthetic import ring_cameras, surface_gaussians
from gsedit.errors import UsageError
from gsedit.mesh import Mesh, mesh, save_mesh
from gsedit.scene.similarity import moved_camera
from gsedit.toolkit.transform import scale, transform
from gsedit.views.cameras_json import write_cameras
from gsedit.views.viewpoints import Viewpoint
from rasterizer.scene import Gaussians, concatenate

COUNT = 2500
EVERY = 1_000_000
"""More faces than are found: none is taken away, which takes most of the time."""


@pytest.fixture(scope="module")
def ball():
    """A sphere of radius 1 of discs, and its cameras."""
    globe = scenes()[0]
    discs = surface_gaussians(globe, COUNT, torch.Generator().manual_seed(0))
    cameras = [c for up in (40.0, -10.0, -55.0) for c in ring_cameras(globe, 5, 48, elevation=up)]
    return discs, cameras


@pytest.fixture(scope="module")
def fused(ball):
    return mesh(*ball, faces=EVERY)


def floaters(scene: Gaussians) -> Gaussians:
    """Some lone opaque Gaussians in the air around the sphere."""
    random = torch.Generator().manual_seed(1)
    away = torch.nn.functional.normalize(torch.randn(12, 3, generator=random), dim=-1)
    some = scene[torch.arange(12)]
    size = torch.full((12, 3), log(0.02))
    return replace(some, means=1.3 * away, log_scales=size)


def test_a_mesh_lies_on_the_exact_surface_and_faces_outwards(fused):
    radii = np.linalg.norm(fused.vertices, axis=1)
    assert np.abs(radii - 1).mean() < 0.01 * 2  # a hundredth of the diameter
    facing = (fused.normals * fused.vertices / radii[:, None]).sum(1)
    assert np.median(facing) > 0.98
    assert 0 <= fused.colors.min() <= fused.colors.max() <= 1


def test_floaters_become_no_triangles(ball):
    discs, cameras = ball
    found = mesh(concatenate(discs, floaters(discs)), cameras, faces=EVERY)
    assert np.linalg.norm(found.vertices, axis=1).max() < 1.1


def before_a_wall(scene: Gaussians, color: float) -> Gaussians:
    """The scene in a far shell of one color, of which some is a skirt around it."""
    random = torch.Generator().manual_seed(2)
    away = torch.nn.functional.normalize(torch.randn(600, 3, generator=random), dim=-1)
    angle = torch.linspace(0, 1, 400)
    rim = torch.stack((angle.cos(), angle.sin(), torch.zeros(400)), -1)
    rim = rim * torch.linspace(1.0, 1.4, 20).repeat(20)[:, None]
    some = scene[torch.arange(1000)]
    size = torch.cat((torch.full((600, 3), log(1.5)), torch.full((400, 3), log(0.05))))
    sh = torch.full_like(some.sh, (color - 0.5) / 0.28209479)
    wall = replace(some, means=torch.cat((8 * away, rim)), log_scales=size, sh=sh)
    return concatenate(scene, wall)


def test_a_backdrop_of_one_color_becomes_no_triangles(ball, fused):
    discs, cameras = ball
    found = mesh(before_a_wall(discs, 0.97), cameras, faces=EVERY)
    assert np.linalg.norm(found.vertices, axis=1).max() < 1.1
    assert found.areas.sum() == pytest.approx(fused.areas.sum(), rel=0.08)


def test_a_watertight_mesh_is_closed_and_has_the_volume(ball):
    discs, cameras = ball
    above = [camera for camera in cameras if float(camera.center[2]) > -1]
    found = mesh(discs, above, watertight=True, faces=3000)
    assert found.is_closed
    assert 500 < len(found.faces) <= 3000
    assert found.volume == pytest.approx(4 / 3 * pi, rel=0.08)


def test_units_are_those_of_the_scene(ball, fused):
    discs, cameras = ball
    moved = [moved_camera(camera, scale(50.0)) for camera in cameras]
    found = mesh(transform(discs, scale=50.0), moved, faces=EVERY)
    assert np.ptp(found.vertices, axis=0) == pytest.approx(
        50 * np.ptp(fused.vertices, axis=0), 0.03
    )


def test_only_what_is_selected_becomes_triangles(ball):
    discs, cameras = ball
    found = mesh(discs, cameras, inside=discs.means[:, 2] > 0, faces=2000)
    assert found.vertices[:, 2].min() > -0.15
    assert len(found.faces) <= 2000


def test_a_scene_without_a_surface_is_refused(ball):
    discs, cameras = ball
    faint = replace(discs, logit_opacities=torch.full((len(discs),), -6.0))
    with pytest.raises(UsageError, match="no surface"):
        mesh(faint, cameras)
    with pytest.raises(UsageError, match="nothing is selected"):
        mesh(discs, cameras, inside=torch.zeros(len(discs), dtype=torch.bool))
    with pytest.raises(UsageError, match="4 faces"):
        mesh(discs, cameras, faces=3)


def tetrahedron() -> Mesh:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Mesh(points, faces, np.array([[1, 0, 0], [0, 0.5, 0], [0, 0, 1], [0.2, 0.2, 0.2]]))


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj", ".stl"])
def test_written_files_hold_the_same_triangles(tmp_path, suffix):
    import trimesh

    solid, path = tetrahedron(), tmp_path / f"solid{suffix}"
    save_mesh(solid, path)
    read = trimesh.load(path, force="mesh")
    turn = np.array([-1, -1, 1]) if suffix == ".glb" else 1
    assert np.sort(read.triangles.sum((1, 2))) == pytest.approx(
        np.sort((solid.vertices[solid.faces] * turn).sum((1, 2))), abs=1e-6
    )
    assert read.volume == pytest.approx(1 / 6, rel=1e-5)
    with pytest.raises(UsageError, match="exists"):
        save_mesh(solid, path)
    with pytest.raises(UsageError, match="name a mesh file"):
        save_mesh(solid, tmp_path / "solid.fbx")


def test_a_glb_that_is_read_again_has_its_place_and_colors(tmp_path):
    solid = replace(tetrahedron(), colors=np.full((4, 3), (0.8, 0.4, 0.1)))
    save_mesh(solid, tmp_path / "solid.glb")
    scene = load(str(tmp_path / "solid.glb"))
    assert (scene.means.min(0).values > -0.01).all()
    colors = 0.5 + 0.28209479 * scene.sh[:, 0].detach().numpy()
    assert colors == pytest.approx(np.broadcast_to((0.8, 0.4, 0.1), colors.shape), abs=0.02)


def test_the_command_writes_a_mesh_from_the_views_beside_the_scene(ball, tmp_path):
    discs, cameras = ball
    save(discs, tmp_path / "ball.ply")
    write_cameras([Viewpoint(f"v{i}", c) for i, c in enumerate(cameras)], tmp_path / "cameras.json")
    out = tmp_path / "ball.stl"
    words = ["mesh", tmp_path / "ball.ply", "-o", out, "--faces", 2000]
    result = gsedit(*words, "--where", "z > -0.5", "--json")
    assert result.exit_code == 0, result.stderr
    record = json.loads(result.stdout)
    assert record["faces"] <= 2000
    assert not record["closed"]
    assert out.stat().st_size == 84 + 50 * record["faces"]
    assert "exists" in gsedit(*words).stderr
    assert "name a mesh file" in gsedit("mesh", tmp_path / "ball.ply", "-o", "a.fbx").stderr
