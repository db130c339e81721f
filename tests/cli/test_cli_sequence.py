"""Sentences of several steps: those of painters and of the 2D editor, one after the other."""

from __future__ import annotations

import json

import pytest
from command_line import gsedit

from gsedit.editing.plan import read_steps


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
    assert record["route"] == "tone+small"
    assert record["instruction"] == words[0]
    assert record["history"] == []
    again = gsedit("edit", scene, *words, "--size", 32, "-o", out)
    assert again.exit_code == 2
