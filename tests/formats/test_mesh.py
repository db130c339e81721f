"""Meshes and point clouds read as Gaussians that lie on their surface and have its colors."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image

from gsedit.formats.files import open_scene
from gsedit.formats.scenes import load
from gsedit.formats.streams import ReadOptions
from gsedit.scene.table import SplatTable

FEW = ReadOptions(samples=2000)
KINDS = (".obj", ".glb", ".stl", ".ply", ".off")


def thinnest(table: SplatTable) -> np.ndarray:
    """The direction of the third axis of each Gaussian."""
    w, x, y, z = table.quats.T
    return np.column_stack(
        (2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z)
    )


def export(mesh: trimesh.Trimesh, path):
    mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", KINDS)
def test_a_sphere_is_covered_evenly_by_disks_that_lie_on_it(suffix, tmp_path):
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    sphere.apply_translation([0, 5, 0])
    source = open_scene(export(sphere, tmp_path / f"a{suffix}"), FEW)
    table = source.table()
    assert len(table) == source.count == 2000
    assert "2,000" in source.notes[0]
    center = np.array([0, -5 if suffix == ".glb" else 5, 0])  # +y is up in glTF, down in memory
    outward = (table.means - center) / 2
    np.testing.assert_allclose(np.linalg.norm(outward, axis=1), 1, atol=0.02)
    assert (np.abs((thinnest(table) * outward).sum(1)) > 0.98).all()
    assert (table.scales[:, 2] < 0.1 * table.scales[:, 0]).all()
    octants = np.bincount((outward > 0) @ [1, 2, 4], minlength=8)
    assert np.ptp(octants) <= 12  # of 250; at random, 16 would be one standard deviation
    again = open_scene(tmp_path / f"a{suffix}", FEW).table()
    np.testing.assert_array_equal(again.means, table.means)


def quad(**visual) -> trimesh.Trimesh:
    """The unit square in the plane z = 0."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False, **visual)


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_colors_are_those_of_the_texture(suffix, tmp_path):
    """Left red and right green, below dark: v points up."""
    pixels = np.zeros((32, 32, 3), np.uint8)
    pixels[:, :16, 0], pixels[:, 16:, 1] = 255, 255
    pixels[16:] //= 2
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    picture = Image.fromarray(pixels)
    material = trimesh.visual.material.SimpleMaterial(picture)
    if suffix == ".glb":  # made from the other kind, trimesh would darken it to 0.4
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    table = open_scene(export(quad(visual=visual), tmp_path / f"a{suffix}"), FEW).table()
    x, y = np.abs(table.means[:, :2]).T
    inside = (np.abs(x - 0.5) > 0.05) & (np.abs(y - 0.5) > 0.05) & (x % 1 > 0.03) & (x < 0.97)
    inside &= (y > 0.03) & (y < 0.97)
    bright = np.where(y > 0.5, 1.0, 127 / 255)
    expected = np.stack((bright * (x < 0.5), bright * (x > 0.5), 0 * x), axis=1)
    np.testing.assert_allclose(table.colors[inside], expected[inside], atol=0.01)


def test_colors_of_vertices_are_mixed(tmp_path):
    mesh = quad(vertex_colors=[[0, 0, 0], [255, 0, 0], [255, 255, 0], [0, 255, 0]])
    table = open_scene(export(mesh, tmp_path / "a.ply"), FEW).table()
    np.testing.assert_allclose(table.colors[:, :2], table.means[:, :2], atol=0.01)


def of_material(colors=None, **values) -> trimesh.Trimesh:
    """The quad with a material, and with colors of its vertices beside it."""
    material = trimesh.visual.material.PBRMaterial(**values)
    visual = trimesh.visual.TextureVisuals(uv=np.full((4, 2), 0.5), material=material)
    if colors is not None:
        visual.vertex_attributes["color"] = np.uint8([colors] * 4)
    return quad(visual=visual)


LINEAR = [55, 255, 0, 255]
"""0.214 of linear light is half of what a screen can show."""


@pytest.mark.parametrize(
    "shape",
    [
        quad(vertex_colors=[LINEAR] * 4),
        trimesh.PointCloud([[0, 0, 0], [1, 0, 0]], [LINEAR] * 2),
        of_material(baseColorFactor=[0.214, 1.0, 0.0, 1.0]),
        of_material([109, 255, 0, 255], baseColorFactor=[0.5, 1.0, 0.0, 1.0]),
        of_material(
            baseColorFactor=[0.428, 1.0, 0.0, 1.0],
            baseColorTexture=Image.new("RGB", (4, 4), (188, 255, 0)),  # 0.5 of linear light
        ),
    ],
    ids=["vertices", "points", "factor", "both", "texture"],
)
def test_colors_of_a_gltf_are_linear_light(shape, tmp_path):
    table = open_scene(export(shape, tmp_path / "a.glb"), FEW).table()
    expected = np.broadcast_to([0.5, 1.0, 0.0], (len(table), 3))
    np.testing.assert_allclose(table.colors, expected, atol=0.01)


def test_a_point_cloud_becomes_balls_as_wide_as_the_points_are_apart(tmp_path):
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), -1).reshape(-1, 3) / 10
    colors = np.tile(np.uint8([255, 0, 51, 255]), (64, 1))
    trimesh.PointCloud(grid, colors).export(tmp_path / "a.ply")
    source = open_scene(tmp_path / "a.ply")
    table = source.table()
    assert len(table) == 64
    assert source.notes == ("a point cloud: 64 round Gaussians",)
    np.testing.assert_allclose(table.scales, 0.05, rtol=1e-4)
    np.testing.assert_allclose(table.colors, np.tile([1, 0, 0.2], (64, 1)), atol=1e-5)
    assert len(load(tmp_path / "a.ply")) == 64
