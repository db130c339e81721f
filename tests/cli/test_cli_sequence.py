"""Sentences of several changes: those of exact routes and of the 2D editor, one after the other."""

from __future__ import annotations

import json

import pytest
from command_line import gsedit
from gsedit_cli.options.editing import EditorOptions
from gsedit_cli.options.routes import read_sentence


@pytest.mark.parametrize(
    ("text", "routes"),
    [
        ("paint it red", [["paint"]]),
        ("paint it red and make it night", [["paint", "light"]]),
        ("paint it red and make it impressionist", [["paint"], ["small"]]),
        ("make it impressionist, then 20% darker", [["small"], ["tone"]]),
    ],
)
def test_a_sentence_is_cut_where_the_route_changes(text, routes):
    steps = read_sentence(text, EditorOptions(), {}) or ()
    assert [[change.route for change in step.changes] for step in steps] == routes


def test_an_option_of_the_2d_editor_takes_it_for_all():
    text = "paint it red and make it impressionist"
    assert read_sentence(text, EditorOptions(editor="small"), {}) is None
    assert read_sentence(text, EditorOptions(), {("batches",): 1}) is None


def test_each_edit_begins_where_the_last_one_ended(scene, photos, tmp_path):
    out = tmp_path / "out"
    words = ("make it 20% darker and impressionist", "--data", photos, "--region", "all")
    result = gsedit("edit", scene, *words, "--size", 32, "--json", "-o", out)
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout.splitlines()[-1])["folder"] == str(out)
    first = json.loads((out / "steps" / "1" / "edit.json").read_text())
    assert first["route"] == "tone"
    record = json.loads((out / "edit.json").read_text())
    assert [each["instruction"] for each in record["history"]] == [first["instruction"]]
    assert record["first_scene"] == record["scene"] == first["scene"] == str(scene)
    again = gsedit("edit", scene, *words, "--size", 32, "-o", out)
    assert again.exit_code == 2
