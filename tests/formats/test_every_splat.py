"""Every splat file at hand to every format and back: what differs is what the format rounds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import cKDTree
from splat_tables import near_grey

from gsedit import orbit
from gsedit.formats.files import WRITABLE, open_scene, write_scene
from gsedit.formats.registry import USD
from gsedit.formats.streams import ReadOptions, SceneHeader, in_blocks
from gsedit.measures.formulas import psnr
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SplatTable, gaussians_of
from rasterizer import render
from rasterizer.numerics import SH_DC

SPLATS = Path(__file__).parents[3] / "shared" / "data" / "splats"
"""Real captures beside the checkout; without them their tests are skipped."""
TINY = Path(__file__).parents[1] / "data" / "splats"
SOURCES = (
    "tiny.ply", "biker.spz", "biker.compressed.ply", "guitar.compressed.ply", "banana.splat",
    "playbot/3_0", "playbot/4_0", "tiny.ply of degree 0", "tiny.ply of degree 1",
)  # fmt: skip
ROWS = 4000


class Kept(NamedTuple):
    """How near a format keeps a scene; each with where its step comes from."""

    suffix: str
    means: float
    """Share of the extent, and what a position has as its own step."""
    angle: float
    """Radians, for all but the worst of a hundred: of a round Gaussian it says nothing."""
    log_scales: float
    """Again but for the worst of a hundred, which codebooks and ranges leave out."""
    opacities: float
    colors: float
    decibels: float
    """PSNR of a picture of the written scene against one of the scene."""
    degree: int = 3
    scale_range: tuple[float, float] = (-np.inf, np.inf)
    """Range of the log-scales; values beyond stop at its ends."""
    color_range: tuple[float, float] = (-np.inf, np.inf)
    """Range of f_dc; values beyond stop at its ends."""


SPZ = {"scale_range": (-10, 5.9375), "color_range": (-0.5 / 0.15, 0.5 / 0.15)}
FORMATS = (
    Kept(".ply", 0, 1e-6, 0, 1e-7, 0, 200),
    # linear scales and opacities, float32
    Kept(".glb", 1e-7, 1e-3, 1e-5, 1e-6, 1e-6, 90),
    # 11, 10, 11 bits of a chunk of 256 rows, 10 bits of a component, 8 of the chunk's colors
    Kept(".compressed.ply", 1 / 1023, 6e-3, 0.02, 1 / 500, 0.05, 45),
    # 12 bits behind the point, scales in steps of 1/16, colors of 1 / (255 * 0.15)
    Kept(".spz", 2**-13, 5e-3, 1 / 32, 1 / 500, 0.0135, 45, **SPZ),
    # 16 bits of a logarithm, 8 of a component, 256 codes of scales and of colors
    Kept(".sog", 1e-4, 0.03, 0.05, 1 / 500, 0.05, 40),
    # float32 places and scales, 8 bits of a component of the quaternion and of a color
    Kept(
        *(".splat", 0, 0.03, 1e-5, 1 / 500, 1 / 510 / SH_DC + 1e-6, 30),
        degree=0,
        color_range=(-0.5 / SH_DC, 0.5 / SH_DC),
    ),
)
STEPS = {kept.suffix: kept for kept in FORMATS}
FOREIGN = {
    "tiny.compressed.ply": STEPS[".compressed.ply"],
    "tiny-gsply.compressed.ply": STEPS[".compressed.ply"],
    # splat-transform keeps 5 and 4 bits of SH, as Niantic's writer does; gsedit writes all 8
    "tiny.3.spz": STEPS[".spz"]._replace(decibels=40),
    "tiny.4.spz": STEPS[".spz"]._replace(decibels=40),
    "tiny-gsply.spz": STEPS[".spz"],
    # it cuts opacities off at a step of 1 / 255, where gsedit rounds to the nearest
    "tiny.sog": STEPS[".sog"]._replace(opacities=1 / 255),
    "tiny.glb": STEPS[".glb"],
    "tiny.splat": STEPS[".splat"],
}
"""Files of one scene that other programs wrote (see tests/data/splats/README.md)."""


def sample(name: str) -> SplatTable:
    """Some rows of a file, evenly."""
    table = open_scene((TINY if name.startswith("tiny") else SPLATS) / name).table()
    return table[:: max(1, len(table) // ROWS)]


def within(table: SplatTable, degree: int) -> SplatTable:
    return table.replace(sh=np.ascontiguousarray(table.sh[:, : (degree + 1) ** 2]))


def again(table: SplatTable, kept: Kept, folder: Path) -> SplatTable:
    """Write the table, and read it again."""
    path = folder / f"a{kept.suffix}"
    write_scene(path, SceneHeader(table.degree), in_blocks(table))
    return open_scene(path).table()


@pytest.fixture(scope="module", params=SOURCES)
def source(request) -> SplatTable:
    if not SPLATS.is_dir() and not request.param.startswith("tiny"):
        pytest.skip("needs ../shared/data/splats")
    name, _, degree = request.param.partition(" of degree ")
    table = sample(name)
    return within(table, int(degree)) if degree else table


@pytest.mark.parametrize("kept", FORMATS, ids=lambda kept: kept.suffix[1:])
def test_there_and_back(kept: Kept, source: SplatTable, tmp_path):
    table = within(source, min(source.degree, kept.degree))
    assert_kept(kept, table, again(table, kept, tmp_path))


def test_every_format_that_is_written_is_here():
    assert set(WRITABLE) - set(USD) <= set(STEPS)


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_other_programs_hold_the_same_scene(name: str):
    kept = FOREIGN[name]
    # gsply writes a scene's own axes into .spz, and the file cannot say so
    options = ReadOptions(spz_frame="rdf" if name == "tiny-gsply.spz" else "rub")
    table = open_scene(TINY / name, options).table()
    assert_kept(kept, within(sample("tiny.ply"), min(2, kept.degree)), table)


def axis_angles(a: SplatTable, b: SplatTable) -> np.ndarray:
    """Largest angle between an axis of an ellipsoid and of its copy, radians.

    A half turn about an own axis leaves an ellipsoid as it is: programs write either quaternion.
    """
    apart = np.einsum("nji,nji->ni", *(rotations(t.quats.astype(np.float64)) for t in (a, b)))
    return np.arccos(np.abs(apart).min(1).clip(0, 1))


def assert_kept(kept: Kept, table: SplatTable, back: SplatTable) -> None:
    """Check that the second table holds the first, but for the steps of the format."""
    assert len(back) == len(table)
    # some formats sort; places are distinct enough to find each row again
    far, rows = cKDTree(back.means).query(table.means)
    extent = float(np.ptp(table.means, axis=0).max())
    assert far.max() <= 2 * (kept.means * max(extent, 1)) + 1e-6
    sure = np.bincount(rows, minlength=len(table))[rows] == 1
    assert sure.mean() > 0.95
    was, now = table[sure], back[rows[sure]]
    scales = np.sort(was.log_scales, axis=1)
    stretched = np.diff(scales, axis=1).min(1) > 0.5  # round ones may turn
    turned = axis_angles(was, now)[stretched]
    assert np.quantile(turned, 0.99) <= kept.angle
    sizes, colors = was.log_scales.clip(*kept.scale_range), was.sh[:, 0].clip(*kept.color_range)
    assert np.quantile(np.abs(sizes - now.log_scales), 0.99) <= kept.log_scales
    assert np.quantile(np.abs(was.opacities - now.opacities), 0.99) <= kept.opacities
    assert np.quantile(np.abs(colors - now.sh[:, 0]), 0.99) <= kept.colors
    shown = gaussians_of(table)
    camera = orbit(shown, 4, 96)[1]
    picture = render(gaussians_of(back), camera).color
    assert psnr(picture, render(shown, camera).color) > kept.decibels


def test_packed_formats_need_neither_torch_nor_gsply(tmp_path):
    """Nor scipy: `gsedit convert` starts in a fraction of a second."""
    paths = [tmp_path / f"a{suffix}" for suffix in (".spz", ".sog", ".glb")]
    table = near_grey(40, 1)
    for path in paths:
        write_scene(path, SceneHeader(1), in_blocks(table))
    program = f"""
import sys
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.streams import in_blocks
for path in {[str(path) for path in paths]}:
    source = open_scene(path)
    write_scene(path, source.header, in_blocks(source.table()), overwrite=True)
print([m for m in ("torch", "scipy", "numba", "gsply", "trimesh") if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
