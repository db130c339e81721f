"""`gsedit list looks`: the looks, the looks that a sentence asks for, and the sheet."""

from __future__ import annotations

import json

import torch
from command_line import gsedit
from PIL import Image

from gsedit.editors.small import look_sheet
from gsedit.words.looks import LOOKS


def test_every_look_is_listed():
    result = gsedit("list", "looks", "--json")
    listed = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["name"] for each in listed] == list(LOOKS)
    assert all(name in gsedit("list", "looks").stdout for name in LOOKS)


def test_a_sentence_is_understood():
    record = json.loads(gsedit("list", "looks", "a golden statue in the snow", "--json").stdout)
    assert [each["name"] for each in record["looks"]] == ["gold", "snow"]
    assert all(0.5 < each["score"] <= 1 for each in record["looks"])
    assert record["known"] is True
    assert gsedit("list", "looks", "dip it in gold").stdout.startswith("gold ")


def test_a_sentence_that_no_look_fulfils_is_not_known():
    record = json.loads(gsedit("list", "looks", "give it a hat", "--json").stdout)
    assert record["known"] is False
    assert len(record["looks"]) == 1
    assert gsedit("list", "looks", "give it a hat").stdout.startswith("none of the known looks")
    assert gsedit("list", "looks", " ").exit_code == 2


def test_the_sheet_shows_every_look(monkeypatch, tmp_path):
    pictures = [torch.full((8, 8, 3), 0.5)] * (len(LOOKS) + 1)
    monkeypatch.setattr(look_sheet, "thumbnails", lambda: pictures)
    path = tmp_path / "looks.png"
    assert gsedit("list", "looks", "-o", path).exit_code == 0
    assert Image.open(path).size[0] > 1000
    assert gsedit("list", "looks", "-o", path).exit_code == 2


def test_an_edit_says_what_it_understood_and_refuses_what_it_does_not(scene, tmp_path):
    hat = gsedit("edit", scene, "give it a hat", "-o", tmp_path / "out")
    assert hat.exit_code == 2
    assert "asks for no look that small knows" in hat.stderr
    assert not (tmp_path / "out").exists()
