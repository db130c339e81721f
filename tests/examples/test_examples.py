"""The examples run, and leave what they promise."""

import json

import pytest
import torch
from command_line import read_events
from demo import demo
from from_gsplat import turn
from labelled import statue
from PIL import Image
from scenes import random_cloud
from world_sheet import CELL_PIXELS, closer, edits, grid, show
from world_sheet import cell as cell_of
from world_sheet import save as save_sheet
from write_an_editor import Fade, run

import gsedit
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.paper.editors import Editor
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.orbit import circle
from gsedit.views.viewpoints import Viewpoint


def test_the_demo_leaves_its_folder(tmp_path, quick_search):
    folder = tmp_path / "demo"
    with pytest.raises(SystemExit) as ended:
        demo(folder, count=1500, size=64)
    assert ended.value.code == 0
    names = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png"}
    names |= {"cameras.json", "views.json", "region.npy", "region_before.npy", "targets"}
    assert names <= {p.name for p in folder.iterdir()} <= names | {"held_out", "held_out_alone"}
    record = json.loads((folder / "edit.json").read_text())
    assert record["instruction"] == "like Van Gogh"
    events = read_events(folder / "metrics.jsonl")
    assert events[-1].stage == "measure"
    assert events[-1].error is not None


def test_a_gsplat_script_renders_a_turn(tmp_path, capsys):
    gsedit.save(random_cloud(200, 0, degree=1).to(torch.float32), tmp_path / "scene.ply")
    turn(tmp_path / "turn", str(tmp_path / "scene.ply"), count=2, size=24)
    sheets = [Image.open(tmp_path / "turn" / f"00{i}.png") for i in range(2)]
    assert [sheet.size for sheet in sheets] == [(48, 24)] * 2
    assert sheets[0].tobytes() != sheets[1].tobytes()
    assert sheets[0].getpixel((0, 0)) == (255, 255, 255)  # the background; no depth beside it
    assert sheets[0].getpixel((24, 0)) == (0, 0, 0)
    assert capsys.readouterr().out.startswith("2 views in ")


def test_an_editor_of_one_s_own_edits_the_bear(tmp_path):
    assert isinstance(Fade(), Editor)
    quick = gsedit.EditSettings(
        update=UpdateSettings(patches=2, patch=16), views_per_batch=2, batches=1
    )
    run(tmp_path, count=1000, size=48, settings=quick, strategy=SinglePass(4))
    assert len(gsedit.load(tmp_path / "scene.ply")) == 1000
    with Image.open(tmp_path / "before_after.png") as sheet:
        assert sheet.size[1] > 3 * 48  # three rows
    with pytest.raises(gsedit.UsageError, match="only fades"):
        Fade().check("make it snow")


def test_a_contact_sheet_shows_cameras_that_no_edit_looked_through(tmp_path):
    labelled = statue(0, 800)
    cameras = circle(
        torch.zeros(3, dtype=torch.float64), 1.5, labelled.scene.up, 9, 48, elevation=20.0, fov=45.0
    )
    viewpoints = [Viewpoint(str(i), camera) for i, camera in enumerate(cameras)]
    shown = show("statue", labelled.gaussians, viewpoints)
    assert not {"0", "8"} & {each.name for each in shown.viewpoints}
    scenes = [shown.scene, *edits(shown, ["make it 20% darker", "buy milk tomorrow"])]
    assert scenes[2] is None
    row = [("", cell_of(scene, shown.camera, CELL_PIXELS)) for scene in scenes]
    save_sheet(grid([row, row]), tmp_path / "sheet.jpg")
    with Image.open(tmp_path / "sheet.jpg") as sheet:
        assert sheet.height > 2 * CELL_PIXELS
    alpha = gsedit.render(shown.scene, shown.camera).alpha > 0.1
    filled = closer(shown.camera, alpha)
    assert filled.fx == pytest.approx(shown.camera.fx, rel=0.1)  # it is filled already
