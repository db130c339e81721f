"""Niantic's .spz: its own quantisation and nothing else, along the axes that it should have."""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

import gsply
import numpy as np
import pytest
import torch
from splat_tables import assert_near, random_table

from gsedit.errors import InputError, UsageError
from gsedit.formats.axes import axes_matrix, from_axes, sh_signs, to_axes
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.scene.quaternions import rotation_of
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import SplatTable
from rasterizer.harmonics import basis

ALL_AXES = ["RDF", "RUB", "LUF", "RUF", "LDB", "RFU", "LFD", "RBU"]
"""Some of Niantic's names, of flipped axes and of ones that change places."""
BOUNDS = {
    "means": 2**-13,
    "angle": 5e-3,  # components in steps of 1.4e-3
    "log_scales": 1 / 32,
    "opacities": 1 / 510,
    "colors": 1 / 510 / 0.15 + 1e-6,
    "sh": 1 / 128,
}
"""Half a step of each value; of SH a whole one, as -1 is stored and 1 is not."""


def covariances(table: SplatTable) -> np.ndarray:
    """R S S^T R^T: what the rotation and the scales of a Gaussian mean."""
    axes = np.stack([rotation_of(q) for q in table.quats]) * table.scales[:, None]
    return axes @ axes.transpose(0, 2, 1)


def write(path: Path, table: SplatTable) -> Path:
    header = SceneHeader(table.degree, antialiased=True)
    write_scene(path, header, in_blocks(table, 70))
    return path


@pytest.mark.parametrize("degree", range(5))
def test_sh_signs_are_the_parity_of_the_basis(degree):
    directions = torch.nn.functional.normalize(torch.randn(20, 3, dtype=torch.float64), dim=1)
    for bits in range(8):
        signs = np.array([1 - 2 * (bits >> axis & 1) for axis in range(3)], np.float64)
        flipped = basis(directions * torch.from_numpy(signs), degree)
        expected = basis(directions, degree) * torch.from_numpy(sh_signs(signs, degree))
        torch.testing.assert_close(flipped, expected)


@pytest.mark.parametrize("name", ALL_AXES)
def test_a_change_of_axes_is_the_similarity_that_it_names(name):
    table = random_table(20, 4)
    stored = to_axes(table, name)
    expected = Similarity(axes_matrix(name).T, 1.0, np.zeros(3)).table(table)
    np.testing.assert_allclose(stored.means, expected.means, atol=1e-6)
    np.testing.assert_allclose(stored.sh, expected.sh, atol=1e-6)
    np.testing.assert_allclose(covariances(stored), covariances(expected), atol=1e-6)
    again = from_axes(stored, name)
    np.testing.assert_allclose(again.means, table.means, atol=1e-6)
    np.testing.assert_allclose(again.sh, table.sh, atol=1e-5)


def test_gsply_reads_what_we_write(tmp_path):
    """It leaves the axes as they are: RUB by the specification."""
    table = random_table()
    ours = gsply.read_spz(write(tmp_path / "a.spz", table))
    sh = np.concatenate((ours.sh0[:, None], ours.shN), 1)
    theirs = SplatTable(ours.means, ours.quats, ours.scales, ours.opacities.reshape(-1), sh)
    assert_near(from_axes(theirs, "RUB"), table, **BOUNDS)


def test_version_2_by_hand(tmp_path):
    """It has x, y, z of the quaternion as bytes."""
    positions = b"".join((v << 8).to_bytes(3, "little", signed=True) for v in (1, 2, -3))
    start = struct.pack("<4sIIBBBB", b"NGSP", 2, 1, 0, 8, 0, 0)
    # alpha, colors, scales, rotation (x = 1, y and z about 0, w rebuilt)
    body = positions + bytes([255]) + bytes([128, 0, 255]) + bytes([160, 144, 128])
    body += bytes([255, 128, 128])
    (tmp_path / "a.spz").write_bytes(gzip.compress(start + body))
    table = open_scene(tmp_path / "a.spz").table()
    np.testing.assert_allclose(table.means, [[1, -2, 3]])
    np.testing.assert_allclose(table.log_scales, [[0, -1, -2]])
    np.testing.assert_allclose(np.abs(table.quats), [[0, 1, 0, 0]], atol=0.01)
    assert table.opacities[0] > 0.999


def test_positions_are_as_fine_as_the_extent_allows(tmp_path):
    table = random_table()
    for extent, step in ((1.0, 2**-12), (5e3, 2**-10), (1e6, 2**-3)):
        far = table.replace(means=table.means * np.float32(extent / np.abs(table.means).max()))
        again = open_scene(write(tmp_path / f"{extent}.spz", far)).table()
        assert np.abs(again.means - far.means).max() <= step / 2 * 1.01
    with pytest.raises(UsageError, match=r"/b\.spz: .*save a \.ply"):  # not its temporary name
        write(tmp_path / "b.spz", table.replace(means=table.means * 1e8))


def test_a_gzip_bomb_is_refused_before_it_fills_memory(tmp_path):
    start = struct.pack("<4sIIBBBB", b"NGSP", 3, 5, 0, 12, 0, 0)
    bomb = zlib.compressobj(9, zlib.DEFLATED, 31)
    data = bomb.compress(start) + bomb.compress(bytes(1 << 26)) + bomb.flush()
    (tmp_path / "a.spz").write_bytes(data)
    with pytest.raises(InputError, match="more than the 116 bytes"):
        open_scene(tmp_path / "a.spz").table()
