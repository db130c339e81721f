"""Six journeys with a scene from end to end: the files, and the JSON of --json."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from bad_files import PLY_COLUMNS, ply_bytes, scene_table
from command_line import EDIT, FIT, answer, ended_early, files, gsedit, names, read_events
from defective import invalid, unwanted
from PIL import Image
from playroom import playroom
from regions_iou import iou

from gsedit import load, load_dataset
from gsedit.formats.files import write_scene
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.views import PathKind
from gsedit.views.cameras_json import read_cameras

BALL = "view_0:20,50"
"""The middle of the red ball in the first view, at 96 pixels."""
REDS = """
import sys
from pathlib import Path
import numpy as np
from PIL import Image
for path in Path(sys.argv[1]).iterdir():
    red, green, blue = np.moveaxis(np.asarray(Image.open(path).convert("RGB")).astype(float), -1, 0)
    mask = (red > 90) & (red > 2 * green) & (red > 2 * blue)
    Image.fromarray((255 * mask).astype(np.uint8)).save(Path(sys.argv[2]) / path.name)
"""
"""A program that masks what is red."""


def test_a_scene_is_read_converted_and_told_about(scene, tmp_path):
    for suffix in (".ply", ".compressed.ply", ".spz", ".glb", ".sog", ".splat"):
        out = tmp_path / f"a{suffix}"
        assert answer("convert", scene, out)["output"] == str(out)
        told = answer("info", out)
        assert (told["gaussians"], told["bytes"]) == (5, out.stat().st_size)
        assert told["sh_degree"] == (0 if suffix == ".splat" else 1)
    means, told = load(scene).means, answer("info", scene)
    assert [told[axis][0] for axis in "xyz"] == means.amin(0).tolist()
    assert [told[axis][-1] for axis in "xyz"] == means.amax(0).tolist()
    before = files(tmp_path)
    assert answer("convert", scene, "--sh-degree", 0, "--dry-run")["gaussians"] == 5
    assert files(tmp_path) == before

    table = scene_table()
    table[3, PLY_COLUMNS.index("y")] = np.nan
    scene.write_bytes(ply_bytes(table))
    told = answer("info", scene)
    assert (told["gaussians"], told["invalid"]) == (4, 1)
    assert gsedit("convert", scene, tmp_path / "b.ply").exit_code == 3
    assert answer("convert", scene, tmp_path / "b.ply", "--drop-invalid")["gaussians"] == 4


def test_a_scene_is_selected_cleaned_and_thinned_out_in_chains(scene, tmp_path):
    out, region = tmp_path / "out.ply", tmp_path / "region.npy"
    answer("select", scene, "--where", "largest(2, opacity)", "-o", region)
    flags = np.load(region)
    assert (flags.dtype, flags.sum()) == (bool, 2)
    for words in (("--region", region), ("--where", f"flags('{region}')")):
        assert answer("filter", scene, *words, "-o", out, "-f")["gaussians"] == 2
        np.testing.assert_array_equal(load(out).means, load(scene).means[flags])
    chained = (
        "filter", scene, "--where", "largest(3, opacity)", "then", "merge", scene,
        "then", "decimate", "50%", "then", "convert", "--sh-degree", 0, "--order", "morton",
    )  # fmt: skip
    assert answer(*chained, "-o", out, "-f")["gaussians"] == len(load(out)) == 4
    assert load(out).degree == 0
    nothing = answer("filter", scene, "--where", "sphere(900,0,0,1)", "--dry-run")
    assert nothing["gaussians"] == 0

    table, rows = unwanted()
    marred, broken = tmp_path / "marred.ply", tmp_path / "broken.ply"
    for path, each in ((marred, table), (broken, invalid()[0])):
        write_scene(path, SceneHeader(each.degree), in_blocks(each))
    told = answer("info", "--check", marred)
    assert {each["name"]: each["rows"] for each in told["defects"]} == rows
    assert gsedit("info", "--check", marred, "--strict").exit_code == 1
    assert gsedit("info", "--check", broken).exit_code == 1
    reasons = tmp_path / "reasons.npy"
    assert gsedit("clean", marred, "--dry-run", "--reasons", reasons).exit_code == 0
    assert len(np.load(reasons)) == len(table)
    assert answer("clean", marred, "--no-floaters", "-o", out, "-f")["gaussians"] == 1601
    assert answer("clean", "--repair", broken, "-o", out, "-f")["gaussians"] == 1595
    assert gsedit("info", "--check", out).exit_code == 0


def test_a_scene_is_drawn_and_shown(place, tmp_path):
    scene, out = place / "room.ply", tmp_path / "out"
    small, shown = ("--size", 24, "-o"), ("--show", "color,depth")
    done = gsedit("render", scene, "--views", "0,2", *shown, *small, out, "--json")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    listed = {Path(line["picture"]) for line in lines if line["type"] == "result"}
    assert listed == set(files(out))
    assert {"000_view_0.png", "000_view_0.depth.npy", "002_view_2.depth.png"} < names(out)
    for path in get_args(PathKind):
        answer("render", scene, "--path", path, "--frames", 2, *small, tmp_path / path)
        assert names(tmp_path / path) == {"frame_0000.png", "frame_0001.png"}
    maps = ("--format", "npy", "--show", "normals,alpha", "--views", "1")
    answer("render", scene, *maps, *small, tmp_path / "maps")
    assert names(tmp_path / "maps") == {"001_view_1.alpha.npy", "001_view_1.normals.npy"}
    assert np.load(tmp_path / "maps/001_view_1.normals.npy").shape == (24, 24, 3)
    turn = tmp_path / "turn.gif"
    told = answer("render", scene, "--frames", 3, "--resolution", "31x23", *shown, "-o", turn)
    assert (told["frames"], told["bytes"]) == (3, turn.stat().st_size)
    with Image.open(turn) as picture:
        assert (picture.size, picture.n_frames) == ((62, 23), 3)
    placed = ("--from", "-5,0,0", "--look-at", "0,0,0", "--up", "z", "--count", 1)
    answer("render", scene, *placed, *small, tmp_path / "placed")
    assert names(tmp_path / "placed") == {"view_000.png"}
    drawn = {}
    for name, more in (
        ("plain", ()), ("torch", ("--kernel", "torch")), ("tinted", ("--region", "all")),
        ("wiped", ("--wipe", scene)), ("clear", ("--background", "transparent")),
    ):  # fmt: skip
        answer("render", scene, "--views", 1, *more, *small, tmp_path / f"{name}.png")
        drawn[name] = np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int)
    assert np.abs(drawn["plain"] - drawn["torch"]).max() <= 1  # rounding may fall to either side
    assert not np.array_equal(drawn["plain"], drawn["tinted"])
    assert (drawn["wiped"][:, 11:13] == 255).all()  # the line between the two
    assert (drawn["clear"][0, 0, 3], drawn["clear"][..., 3].max() > 200) == (0, True)


def test_a_scene_without_cameras_is_drawn_and_shown_on_a_page(place, tmp_path):
    scene = place / "room.ply"
    (place / "cameras.json").unlink()
    answer("render", scene, "--count", 2, "--size", 16, "-o", tmp_path / "found")
    assert names(tmp_path / "found") == {"view_000.png", "view_001.png"}
    page = tmp_path / "page.html"
    assert answer("view", scene, "-o", page)["page"] == str(page)
    assert page.stat().st_size > 1000


def test_photos_become_a_scene_that_is_edited_and_measured(place, tmp_path):
    photos, scene = place / "photos", tmp_path / "fit/scene.ply"
    fit = ("fit", photos, *FIT, "-o", scene)
    with ended_early("fit", KeyboardInterrupt()):
        assert gsedit(*fit).exit_code == 130
    assert names(scene.parent) == {"scene.checkpoint.safetensors"}
    assert gsedit(*fit).exit_code == 2  # a second run does not write over it unasked
    told = answer(*fit, "--resume")
    assert (told["scene"], told["gaussians"]) == (str(scene), len(load(scene)))
    assert (told["steps"], told["curve"][-1][1]) == (FIT[1], told["psnr"])
    assert names(scene.parent) == {"scene.ply", "cameras.json"}
    recorded = read_cameras(scene.with_name("cameras.json"))
    assert [v.name for v in recorded] == [v.name for v in load_dataset(photos).views]

    out = tmp_path / "edit"
    edit = ("edit", scene, *EDIT, "-o", out)
    with ended_early("edit", KeyboardInterrupt()):
        assert gsedit(*edit).exit_code == 130
    assert names(out) == {"checkpoint.safetensors", "metrics.unfinished.jsonl"}
    assert gsedit(*edit).exit_code == 2
    other = ("--editor", "command", "--run", "true")
    assert gsedit(*edit, "--resume", *other).exit_code == 2  # another request
    assert answer(*edit, "--resume")["folder"] == str(out)
    assert gsedit(*edit, "--resume").exit_code == 2  # it is done
    kept = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png", "cameras.json"}
    kept |= {"views.json", "region.npy"}
    assert {name for name in names(out) if "/" not in name} == kept
    own = json.loads((out / "edit.json").read_text())
    assert {each.stage for each in read_events(out / "metrics.jsonl")} >= {"sample", "measure"}
    assert (own["instruction"], own["settings"]["batches"]) == ("as bronze", 1)
    assert set(own) >= {"seed", "versions", "threads", "timings", "platform", "python"}

    measure_and_go_on(out, scene, own, tmp_path)


def measure_and_go_on(out, scene, own, tmp_path):
    """The rest of that journey: what the edit measured is measured again, and it is edited."""
    measured = answer("metrics", out, "-o", tmp_path / "record.json")["measured"]
    assert json.loads((tmp_path / "record.json").read_text())["measured"] == measured
    assert measured["seconds"] == own["timings"]["total"]
    for name, tolerance in (("rmse_to_unedited", 1e-5), ("psnr_to_targets", 0.1)):  # 8 bits
        for role, mean in measured[name].items():
            again = own["measured"][name][role]
            assert mean["value"] == pytest.approx(again["value"], abs=tolerance), name
            assert mean["views"] == again["views"]

    further = tmp_path / "further"
    answer("edit", out, "make it 20 % brighter", "-o", further)
    later = json.loads((further / "edit.json").read_text())
    assert (later["scene"], later["first_scene"]) == (str(out / "scene.ply"), str(scene))
    assert [each["instruction"] for each in later["history"]] == ["as bronze"]


def test_a_thing_is_edited_by_a_click_a_name_and_a_mask(place, tmp_path):
    scene, true = place / "room.ply", playroom().of("red ball")
    clicked, drawn = tmp_path / "clicked.npy", tmp_path / "drawn.npy"
    small = ("--size", 96)
    answer("select", scene, *small, "--at", BALL, "--as", "the ball", "-o", clicked)
    (tmp_path / "reds.py").write_text(REDS)
    program = f"{sys.executable} {tmp_path / 'reds.py'} {{input}} {{output}}"
    masks = ("--masks", "command", "--masks-run", program)
    answer("select", scene, *small, *masks, "--phrase", "the pomegranate", "-o", drawn)
    assert min(iou(np.load(each), true) for each in (clicked, drawn)) > 0.8
    found = answer("select", scene, *small, "--objects", "-o", tmp_path / "objects.png")
    assert {"red", "blue", "white", "yellow", "ground"} <= {s["name"] for s in found["segments"]}
    assert sum(each["gaussians"] for each in found["segments"]) == len(true)
    alone = answer("filter", scene, "--region", "The Ball", "-o", tmp_path / "alone.ply")
    assert alone["gaussians"] == np.load(clicked).sum()

    before, flags = load(scene).sh, np.load(clicked)
    for name, words in {
        "click": ("paint the table teal", "--at", BALL), "name": ("paint the ball teal",),
        "region": ("paint it teal", "--region", clicked),
        "mask": ("paint it teal", "--region", drawn),
    }.items():  # fmt: skip
        out, picture = tmp_path / name, tmp_path / f"{name}.png"
        folder = names(tmp_path)
        if name in ("click", "mask"):
            answer("edit", scene, *words, *small, "--preview", "-o", picture)
            assert names(tmp_path) - folder == {picture.name}
        told = answer("edit", scene, *words, *small, "-o", out)
        assert told["folder"] == str(out)
        assert names(out) >= {"scene.ply", "region.npy", "edit.json", "before_after.png"}
        inside = np.load(out / "region.npy")
        assert (inside == (np.load(drawn) if name == "mask" else flags)).all()
        changed = (load(out / "scene.ply").sh != before).flatten(1).any(1).numpy()
        assert changed.any()
        assert not changed[~inside].any()
        assert json.loads((out / "edit.json").read_text())["route"] == "paint"
    explained = names(tmp_path)
    asked = gsedit("edit", scene, "remove the ball", "-o", tmp_path / "none", "--explain")
    assert asked.exit_code == 0
    assert names(tmp_path) == explained


def test_a_scene_is_measured_compared_and_exported(place, tmp_path):
    scene = place / "room.ply"
    told = answer("measure", scene, "--at", "0,0,0", "--at", "3,4,0")["distance"]
    assert told["value"] == pytest.approx(5)
    assert told["interval_95"] == pytest.approx([5, 5])
    scaled, saved = tmp_path / "scaled.ply", tmp_path / "found.json"
    answer("align", scene, "--length", "0,0,0,0,0,2=5", "--save", saved, "-o", scaled)
    np.testing.assert_allclose(load(scaled).means, 2.5 * load(scene).means, atol=1e-5)
    answer("transform", scene, "--matrix", saved, "-o", tmp_path / "again.ply")
    np.testing.assert_allclose(load(tmp_path / "again.ply").means, load(scaled).means, atol=1e-5)

    cut = tmp_path / "cut.ply"
    answer("filter", scene, "--where", "largest(5600, opacity)", "-o", cut)
    told = answer("diff", scene, cut, "--count", 2, "--size", 24, "-o", tmp_path / "diff.png")
    assert told["counts"] == [7000, 5600]
    assert len(told["views"]) == 2
    assert told["worst_view"] in {each["name"] for each in told["views"]}
    assert min(Image.open(tmp_path / "diff.png").size) > 250

    mesh = tmp_path / "mesh.glb"
    told = answer("mesh", scene, "--faces", 300, "-o", mesh)
    assert told["mesh"] == str(mesh)
    assert mesh.stat().st_size > 1000
    assert 4 <= told["faces"] <= 300
