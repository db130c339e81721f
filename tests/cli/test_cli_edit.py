"""`gsedit edit`: where objects go, sentences of several steps, and what `gsedit looks` reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from command_line import answer, gsedit

from gsedit import load
from gsedit.editing.plan import read_steps
from gsedit.scene.outcome import NEW, Outcome
from gsedit.select.saved import save_named, saved_file, saved_names
from gsedit.words.lexicon import styles
from rasterizer.scene import concatenate


@pytest.fixture(autouse=True)
def filled(monkeypatch):
    """A removal that fills the hole with two Gaussians."""

    def remove(scene, inside, cameras=(), execution=None):
        rows = torch.nonzero(~inside).flatten()
        origin = torch.cat((rows, torch.tensor([NEW, NEW])))
        return Outcome(concatenate(scene[rows], scene[:2]), origin, origin == NEW, ("2 fill it",))

    monkeypatch.setattr("gsedit.change.objects.remove", remove)


@pytest.fixture
def region(tmp_path) -> Path:
    np.save(tmp_path / "some.npy", np.array([True, False, True, True, False]))
    return tmp_path / "some.npy"


@pytest.fixture
def removed(scene, photos, region, tmp_path) -> Path:
    """The folder of a removal."""
    out = tmp_path / "removed"
    words = ("edit", scene, "remove it", "--data", photos, "--region", region, "-o", out)
    answer(*words)
    return out


def test_the_folder_has_flags_of_both_scenes(scene, removed, region):
    assert (np.load(removed / "region_before.npy") == np.load(region)).all()
    assert np.load(removed / "region.npy").tolist() == [False, False, True, True]
    assert len(load(removed / "scene.ply")) == 4
    record = json.loads((removed / "edit.json").read_text())
    assert record["understood"]["changes"][0]["name"] == "remove"
    assert record["objects"]["changed_or_gone"] == 3
    assert record["notes"][0] == "2 fill it"


def test_a_removal_is_measured_compared_edited_further_and_undone(removed, scene, photos):
    assert answer("metrics", removed)["measured"]
    assert answer("diff", scene, removed)["counts"] == [5, 4]
    again, flags = removed.with_name("again"), removed / "region.npy"
    words = ("edit", removed, "paint it teal", "--data", photos, "--region", flags, "-o", again)
    answer(*words)
    changed = (load(again / "scene.ply").sh != load(removed / "scene.ply").sh).any(-1).any(-1)
    assert changed.tolist() == [False, False, True, True]
    later = json.loads((again / "edit.json").read_text())
    assert later["scene"] == str(removed / "scene.ply")  # one step back
    assert later["first_scene"] == str(scene)  # all steps back
    assert [each["instruction"] for each in later["history"]] == ["remove it"]
    assert not (again / "region_before.npy").exists()


def test_a_scene_without_its_background_is_measured(scene, photos, region, tmp_path):
    out = tmp_path / "alone"
    words = ("edit", scene, "delete the background", "--data", photos, "--region", region)
    answer(*words, "-o", out)
    assert len(load(out / "scene.ply")) == 3
    assert answer("metrics", out)["measured"]


def test_names_follow_an_edit_of_several_steps(scene, photos, tmp_path):
    means = load(scene).means.numpy()
    save_named(np.arange(5) == 1, means, scene, "Left_Leg-2")
    save_named(np.arange(5) >= 3, means, scene, "the hat")
    out, again, more = tmp_path / "out", tmp_path / "again", ("--data", photos, "-o")
    answer("edit", scene, "remove left_leg-2", *more, out)
    hat = saved_file(out / "scene.ply", "my hat")
    assert hat is not None
    assert np.load(hat).tolist() == [False, False, True, True, False, False]
    assert gsedit("edit", out, "make the left leg 2 darker", *more, again).exit_code == 2
    answer("edit", out, "make it impressionist and then paint the hat gold", *more, again)
    assert np.load(again / "region.npy").all()  # the painting reached everything
    assert saved_names(again / "scene.ply") == ("Left_Leg-2", "the hat")


@pytest.mark.parametrize(
    ("text", "routes"),
    [
        ("paint it red", [["paint"]]),
        ("paint it red and make it night", [["paint", "light"]]),
        ("paint it red and make it impressionist", [["paint"], ["style"]]),
        ("make it impressionist, then 20% darker", [["style"], ["tone"]]),
    ],
)
def test_a_sentence_is_cut_where_the_route_changes(text, routes):
    steps = read_steps(text)
    assert [[change.route for change in step.changes] for step in steps] == routes
    (drawn,) = read_steps(text, drawn=True)
    assert drawn.text == text


def test_all_steps_are_in_one_folder(scene, photos, tmp_path):
    out = tmp_path / "out"
    words = ("make it 20% darker and impressionist", "--data", photos, "--region", "all")
    result = gsedit("edit", scene, *words, "--size", 32, "--json", "-o", out)
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout.splitlines()[-1])["folder"] == str(out)
    record = json.loads((out / "edit.json").read_text())
    assert record["route"] == "tone+style"
    assert record["instruction"] == words[0]
    assert record["history"] == []
    again = gsedit("edit", scene, *words, "--size", 32, "-o", out)
    assert again.exit_code == 2


def test_every_look_is_listed():
    result = gsedit("list", "looks", "--json")
    listed = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["name"] for each in listed if each["kind"] == "style"] == list(styles())
    assert {"bronze", "sunset", "snow"} <= {each["name"] for each in listed}


def test_a_sentence_is_read():
    result = gsedit("list", "looks", "paint the bear teal and lower the contrast by 20%", "--json")
    record = json.loads(result.stdout)
    assert record["known"] is True
    assert record["changes"] == [
        {
            "target": "subject", "kind": "paint", "name": "teal", "color": "#029386",
            "amount": None, "route": "paint", "phrase": "the bear", "place": None, "keep": [],
        },
        {
            "target": "scene", "kind": "tone", "name": "contrast", "color": None,
            "amount": -0.2, "route": "tone", "phrase": "", "place": None, "keep": [],
        },
    ]  # fmt: skip


def test_a_sentence_that_nothing_fulfills_is_refused_with_the_reason():
    record = json.loads(gsedit("list", "looks", "give it a hat", "--json").stdout)
    assert (record["known"], record["changes"]) == (False, [])
    assert record["why"]
