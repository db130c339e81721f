"""`gsedit select` by a pixel or by words, the list of objects, and names as regions."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import gsedit
from PIL import Image
from playroom import playroom

from gsedit import load, save
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.viewpoints import Viewpoint

ON_BALL = "view_0:20,50"
"""The middle of the red ball in the first view, at 96 pixels."""


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    made = playroom()
    folder = tmp_path_factory.mktemp("room")
    save(made.scene, folder / "room.ply")
    views = [Viewpoint(f"view_{i}", camera) for i, camera in enumerate(made.cameras)]
    write_cameras(views, folder / "cameras.json")
    return folder / "room.ply"


def select(room, *words):
    return gsedit("select", room, "--size", 96, *words)


def test_a_selection_is_saved_by_name_and_stands_for_a_region(room, tmp_path):
    result = select(room, "--at", ON_BALL, "--as", "the ball", "-o", tmp_path / "ball.npy")
    assert result.exit_code == 0, result.stderr
    flags = np.load(tmp_path / "ball.npy")
    true = playroom().of("red ball").numpy()
    assert (flags & true).sum() > 0.9 * (flags | true).sum()
    words = ["--region", "The Ball", "-o", tmp_path / "alone.ply"]
    assert gsedit("filter", room, *words).exit_code == 0
    assert len(load(tmp_path / "alone.ply")) == flags.sum()
    again = select(room, "--at", ON_BALL, "--as", "the ball")
    assert again.exit_code == 2
    assert "add --force" in again.stderr
    stale = tmp_path / "alone.regions"
    stale.mkdir()
    np.save(stale / "the ball.npy", flags)
    other = gsedit("filter", tmp_path / "alone.ply", "--region", "the ball", "--dry-run")
    assert other.exit_code == 3
    assert "belongs to the scene that it was made for" in other.stderr


def test_a_click_is_what_a_sentence_speaks_of(room, tmp_path):
    select(room, "--at", ON_BALL, "-o", tmp_path / "ball.npy")
    out = tmp_path / "out"
    words = ("edit", room, "paint the table teal", "--at", ON_BALL, "--size", 96)
    result = gsedit(*words, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert (np.load(out / "region.npy") == np.load(tmp_path / "ball.npy")).all()
    assert (
        json.loads((out / "edit.json").read_text())["settings"]["region"]
        == "click('view_0', 20, 50)"
    )
    shown = gsedit(*words, "--preview", "-o", tmp_path / "p.png")
    assert shown.exit_code == 0, shown.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("paint it teal", "--at", ON_BALL, "--region", "all"), "leave one out"),
        (("paint it teal", "--at", "view_0:20"), "give a view, a column and a row"),
        (("paint it teal", "--at", "0:1,1"), "nothing is at"),
        (("paint it teal and make it impressionist", "--at", ON_BALL), "2 edits"),
        (("make it impressionist", "--masks", "command", "--masks-run", "true"), "2D editor"),
        (("remove it", "--editor", "small", "--masks", "clipseg"), "2D editor"),
    ],
)
def test_what_a_click_or_masks_cannot_do_is_refused_in_a_line(room, tmp_path, words, message):
    result = gsedit("edit", room, *words, "--size", 96, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_masks_are_listed():
    result = gsedit("list", "masks", "--json")
    listed = {row["name"]: row["summary"] for row in map(json.loads, result.stdout.splitlines())}
    assert {"command", "clipseg", "grounded-sam"} <= set(listed)
    assert all("--masks-" in listed[name] for name in ("command", "clipseg", "grounded-sam"))
    assert "command" in gsedit("list", "masks").stdout


def test_an_unknown_name_is_refused_with_those_that_are_saved(room, tmp_path):
    select(room, "--phrase", "the ground", "--as", "floor", "--force")
    result = gsedit("filter", room, "--region", "chair", "-o", tmp_path / "x.ply")
    assert result.exit_code == 2
    assert "floor" in result.stderr


def test_objects_are_listed_and_drawn(room, tmp_path):
    result = select(room, "--objects", "--json", "-o", tmp_path / "objects.png")
    assert result.exit_code == 0, result.stderr
    listed = json.loads(result.stdout)["segments"]
    assert {"red", "blue", "white", "yellow", "ground"} <= {row["name"] for row in listed}
    assert sum(row["gaussians"] for row in listed) == len(playroom().scene)
    assert Image.open(tmp_path / "objects.png").width > 400


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--at", "view_0:20"], "give a view, a column and a row"),
        (["--at", "viewer_0:2,3"], "did you mean view_0"),
        (["--at", "0:200,3"], "beside the picture of view_0"),
        (["--at", "0:1,1"], "nothing is at 1.5,1.5 of view_0"),
        (["--at", ON_BALL, "--phrase", "it"], "leave one out"),
        (["--at", ON_BALL, "--as", "a/b"], "no name for a selection"),
        (["--at", ON_BALL, "--as", "auto"], "no name for a selection"),
        (["--phrase", "the purple one"], "--objects"),
        (["--phrase", "everything"], "whole scene"),
        (["--as", "ball"], "add one of them"),
        (["--objects", "--where", "x > 0"], "go alone"),
    ],
)
def test_what_cannot_be_selected_is_refused_in_a_line(room, words, message):
    result = select(room, *words, "--dry-run")
    assert result.exit_code == 2
    assert message in result.stderr
    assert not room.with_name("room.regions").joinpath("a").exists()


@pytest.mark.parametrize("name", ["it", "Ground", "the subject", "everything", "one"])
def test_a_word_that_means_something_else_is_no_name(room, name):
    result = select(room, "--at", ON_BALL, "--as", name)
    assert result.exit_code == 2
    assert "is no name for a selection" in result.stderr


def test_things_that_only_a_network_knows_are_refused(room):
    result = select(room, "--phrase", "the ears", "--as", "ears")
    assert result.exit_code == 2
    assert "cannot be known without a network" in result.stderr


def test_a_saved_name_wins_in_a_sentence_and_its_preview(room, tmp_path):
    select(room, "--at", ON_BALL, "--as", "plinth", "--force")
    words = ("--size", 64, "--preview", "-o", tmp_path / "p.png")
    result = gsedit("edit", room, "remove the plinth", *words)
    assert result.exit_code == 0, result.stderr
    assert "the plinth, as it was saved" in result.stderr
    assert "Gaussians left" in result.stderr
