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


def test_a_sentence_is_read():
    result = gsedit("looks", "paint the bear teal and lower the contrast by 20%", "--json")
    record = json.loads(result.stdout)
    assert record["known"] is True
    assert record["changes"] == [
        {
            "target": "subject", "kind": "paint", "name": "teal", "color": "#029386",
            "amount": None, "route": "paint", "phrase": "", "place": None,
        },
        {
            "target": "scene", "kind": "tone", "name": "contrast", "color": None,
            "amount": -0.2, "route": "tone", "phrase": "", "place": None,
        },
    ]  # fmt: skip


def test_a_sentence_that_nothing_fulfills_is_refused_with_the_reason():
    record = json.loads(gsedit("looks", "give it a hat", "--json").stdout)
    assert (record["known"], record["changes"]) == (False, [])
    assert record["why"]


def test_the_sheet_shows_every_look(monkeypatch, tmp_path):
    pictures = [torch.full((8, 8, 3), 0.5)] * (len(LOOKS) + 1)
    monkeypatch.setattr(look_sheet, "thumbnails", lambda: pictures)
    path = tmp_path / "looks.png"
    assert gsedit("list", "looks", "-o", path).exit_code == 0
    assert Image.open(path).size[0] > 1000
    assert gsedit("list", "looks", "-o", path).exit_code == 2
