"""The defects of a scene: listed by info --check, repaired and removed by clean."""

from __future__ import annotations

import json

from command_line import gsedit
from defective import invalid, unwanted

from gsedit.formats.registry import write_scene
from gsedit.formats.streams import SceneHeader, in_blocks


def written(table, path):
    write_scene(path, SceneHeader(table.degree), in_blocks(table))


def test_check_repair_and_clean(tmp_path):
    table, rows = unwanted()
    broken, _ = invalid()
    for name, each in (("unwanted", table), ("broken", broken)):
        written(each, tmp_path / f"{name}.ply")
    result = gsedit("info", "--check", tmp_path / "unwanted.ply", "--json")
    assert result.exit_code == 0
    record = json.loads(result.stdout)
    assert {d["name"]: d["rows"] for d in record["defects"]} == rows
    assert gsedit("info", "--check", tmp_path / "unwanted.ply", "--strict").exit_code == 1
    result = gsedit("info", "--check", tmp_path / "broken.ply")
    assert result.exit_code == 1
    assert "--repair" in result.stdout
    out = tmp_path / "out.ply"
    result = gsedit("clean", "--repair", tmp_path / "broken.ply", "-o", out)
    assert "clean: kept 1,595 of 1,600 (-0.3 %)" in result.stderr
    result = gsedit("clean", tmp_path / "unwanted.ply", "--no-floaters", "-o", out, "-f")
    assert "1 needle" in result.stderr
    assert "clean: kept 1,601 of 1,605 (-0.2 %)" in result.stderr
    result = gsedit("clean", tmp_path / "unwanted.ply", "--dry-run", "--where", "x <")
    assert result.exit_code == 2
    for words in (("--repair", "--mark"), ("--repair", "--where", "x < 0")):
        assert gsedit("clean", tmp_path / "broken.ply", *words, "-o", out, "-f").exit_code == 2
    assert gsedit("info", tmp_path / "broken.ply", "--strict").exit_code == 2
    assert gsedit("info", "--check", tmp_path / "broken.ply", "--plot", "a.png").exit_code == 2


def test_the_file_of_reasons_is_replaced_with_force(tmp_path):
    scene, reasons = tmp_path / "scene.ply", tmp_path / "reasons.npy"
    written(unwanted()[0], scene)
    words = ("clean", scene, "--dry-run", "--reasons", reasons)
    assert gsedit(*words).exit_code == 0
    assert "add -f" in gsedit(*words).stderr
    assert gsedit(*words, "-f").exit_code == 0
