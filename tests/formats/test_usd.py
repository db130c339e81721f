"""OpenUSD's splats, through usd-core."""

from __future__ import annotations

import shutil
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from splat_tables import random_table

from gsedit.errors import InputError
from gsedit.formats.axes import RUB, from_axes
from gsedit.formats.files import open_scene, write_scene
from gsedit.formats.registry import USD
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.scene.table import SplatTable
from gsedit.toolkit.align import AlignLength
from gsedit.toolkit.transform import Transform, scale

TINY = Path(__file__).parents[1] / "data" / "splats"
FIELDS = ("means", "log_scales", "opacities", "sh")
pytestmark = pytest.mark.skipif(find_spec("pxr") is None, reason="needs usd-core (gsedit[usd])")


def write(path: Path, table: SplatTable, **header) -> Path:
    write_scene(path, SceneHeader(table.degree, **header), in_blocks(table, 70), overwrite=True)
    return path


def assert_same(a: SplatTable, b: SplatTable, tolerance: float = 2e-6) -> None:
    assert len(a) == len(b)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=tolerance, err_msg=name)
    turns = [t.quats / np.linalg.norm(t.quats, axis=1, keepdims=True) for t in (a, b)]
    np.testing.assert_allclose(np.abs((turns[0] * turns[1]).sum(1)), 1, atol=tolerance)


def text(tmp_path: Path, body: str, metadata: str = "") -> Path:
    path = tmp_path / "a.usda"
    path.write_text(f"#usda 1.0\n({metadata}\n)\n{body}")
    return path


def field(name: str, count: int = 2, more: str = "") -> str:
    rows = ", ".join(f"({i}, {10 * i}, 0.5)" for i in range(count))
    start = f'def ParticleField3DGaussianSplat "{name}" {{\n'
    return f"{start}  point3f[] positions = [{rows}]\n{more}}}\n"


@pytest.mark.parametrize("degree", [0, 3, 4])
def test_text_keeps_places_and_light_exactly(degree, tmp_path):
    table = random_table(200, degree)
    source = open_scene(write(tmp_path / "a.usda", table, comments=("mine",), antialiased=True))
    again = source.table()
    np.testing.assert_array_equal(again.means, table.means)
    np.testing.assert_array_equal(again.sh, table.sh)
    assert_same(again, table, 1e-5)
    assert (source.header.degree, source.header.comments) == (degree, ("mine",))
    assert source.header.antialiased


def test_the_unit_changes_with_the_scale():
    header = SceneHeader(0, comments=("mine", "metersPerUnit 0.01", "upAxis Z"))
    doubled = Transform(scale(2.0)).header(header)
    assert doubled.comments == ("mine", "metersPerUnit 0.005", "upAxis Z")
    known = AlignLength((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0)
    assert known.header(header).comments == ("mine", "upAxis Z")


@pytest.mark.parametrize("suffix", USD)
def test_the_library_reads_what_is_written(suffix, tmp_path):
    from pxr import Usd, UsdGeom, UsdVol  # pyright: ignore[reportMissingImports]

    table = random_table(60, 2)
    path = write(tmp_path / f"a{suffix}", table, comments=("metersPerUnit 0.5",))
    stage = Usd.Stage.Open(str(path))
    splats = UsdVol.ParticleField3DGaussianSplat(stage.GetDefaultPrim())
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.5
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    stored = from_axes(table, RUB)  # a half turn: there as back
    quats = [(q.GetReal(), *q.GetImaginary()) for q in splats.GetOrientationsAttr().Get()]
    sh = np.array(splats.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()).reshape(60, 9, 3)
    as_told = SplatTable(
        np.array(splats.GetPositionsAttr().Get()),
        np.array(quats, np.float32),
        np.log(np.array(splats.GetScalesAttr().Get())),
        stored.logit_opacities,
        sh,
    )
    assert_same(as_told, stored)
    opacities = np.array(splats.GetOpacitiesAttr().Get())
    np.testing.assert_allclose(opacities, table.opacities, atol=1e-6)
    assert splats.GetRadianceSphericalHarmonicsDegreeAttr().Get() == 2
    low, high = splats.GetExtentAttr().Get()
    assert (np.array(low) < stored.means.min(0)).all()
    assert (np.array(high) > stored.means.max(0)).all()
    assert_same(open_scene(path).table(), table, 1e-5)


def test_a_binary_file_of_nvidia_is_read():
    source = open_scene(TINY / "tiny.usdc")
    table = open_scene(TINY / "tiny.ply").table()
    assert_same(source.table(), from_axes(table, RUB), 1e-5)


def test_definitions_are_merged_each_in_its_place(tmp_path):
    degree_0 = field("a", 2, "  uniform int radiance:sphericalHarmonicsDegree = 0\n")
    body = f"""
def Xform "world" {{
  double3 xformOp:translate = (1, 2, 3)
  float3 xformOp:rotateXYZ = (0, 0, 90)
  uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
  {degree_0}
  def Scope "hidden" {{ token visibility = "invisible"
    {field("b")} }}
  over "c" {{}}
  class ParticleField3DGaussianSplat "d" {{
    point3f[] positions = [(9, 9, 9)]
  }}
}}
{field("e", 1)}
def Mesh "f" {{}}
"""
    source = open_scene(text(tmp_path, body, '"a comment"\n upAxis = "Y" # words'))
    table = source.table()
    assert source.count == 3
    # y is up in the file, down in memory; the defaults of the schema: opaque, size 1, grey
    expected = [(1, -2, -3.5), (-9, -3, -3.5), (0, 0, -0.5)]
    np.testing.assert_allclose(table.means, expected, atol=1e-6)
    np.testing.assert_allclose(table.scales, 1, atol=1e-6)
    np.testing.assert_allclose(table.colors, 0.5)
    assert (table.opacities > 0.999).all()
    assert source.notes == (
        "meshes, points and other shapes left out: 1",
        "splats that the stage hides left out: 1",
        "splats merged from 2 definitions",
    )


REFUSED = {
    "shears": (field("a").replace("{\n", '{\n float3 xformOp:scale = (1, 2, 1)\n uniform token[] '
               'xformOpOrder = ["xformOp:scale"]\n', 1), "scales the axes differently"),
    "short": (field("a", 2, "  float[] opacities = [0.5]\n"), "1 opacities, 2 are needed"),
    "no numbers": (field("a", 2, "  float[] opacities = [0.5, nine]\n"), "cannot be read"),
    "moves": (field("a", 2, "  float[] opacities.timeSamples = { 0: [1], 1: [2] }\n"), "over time"),
    "nothing": ('def Mesh "a" {}', "no ParticleField3DGaussianSplat"),
    "cut": (field("a")[:-3], "cannot be read"),
    "deep": ('def "a" {' * 200, "cannot be read"),
    "brackets": ('def "a" { int x = ' + "(" * 200, "cannot be read"),
    "degree": (field("a", 1, "  int radiance:sphericalHarmonicsDegree = 9\n  float3[] "
               "radiance:sphericalHarmonicsCoefficients = [(1, 2, 3)]\n"), "SH degree of 9"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_right_is_one_line(name, tmp_path):
    body, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as error:
        open_scene(text(tmp_path, body)).table()
    assert str(tmp_path / "a.usda") in str(error.value)
    assert "\n" not in str(error.value)


def test_layers_of_one_folder_are_put_together_and_no_others(tmp_path):
    inside, outside = tmp_path / "in", tmp_path / "out.usda"
    inside.mkdir()
    table = random_table(20, 1)
    shutil.copy(write(outside, table), inside / "part.usda")
    (inside / "link.usda").symlink_to(outside)

    def refer(name: str) -> Path:
        body = f'def "w" (\n prepend references = @{name}@\n) {{}}\n'
        return text(inside, body, '\n upAxis = "Y"')

    assert_same(open_scene(refer("part.usda")).table(), table, 1e-5)
    for name in ("../out.usda", str(outside), "link.usda", "`'a'`"):
        with pytest.raises(InputError, match=r"a\.usda cannot be read as USD"):
            open_scene(refer(name))
    with zipfile.ZipFile(inside / "a.usdz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.usda", b"#usda 1.0\n" + b" " * (64 << 20))
    with pytest.raises(InputError, match="cannot be read as USD"):
        open_scene(inside / "a.usdz")
