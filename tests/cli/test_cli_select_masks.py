"""`gsedit select --phrase ... --masks`: a program draws masks, and options that do not fit."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import gsedit
from playroom import playroom

from gsedit import save
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.viewpoints import Viewpoint

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


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    made = playroom()
    folder = tmp_path_factory.mktemp("room")
    save(made.scene, folder / "room.ply")
    views = [Viewpoint(f"view_{i}", camera) for i, camera in enumerate(made.cameras)]
    write_cameras(views, folder / "cameras.json")
    (folder / "reds.py").write_text(REDS)
    return folder / "room.ply"


def test_a_program_finds_a_word_that_is_not_known(room, tmp_path):
    words = [
        "--masks",
        "command",
        "--masks-run",
        f"{{python}} {room.parent}/reds.py {{input}} {{output}}",
    ]
    words += ["--phrase", "the pomegranate", "-o", tmp_path / "found.npy", "--json"]
    result = gsedit("select", room, "--size", 96, *words)
    assert result.exit_code == 0, result.stderr
    assert "'the pomegranate' by command" in json.loads(result.stdout)["note"]
    assert "masks: 1/" in result.stderr
    true, flags = playroom().of("red ball").numpy(), np.load(tmp_path / "found.npy")
    assert (flags & true).sum() > 0.8 * (flags | true).sum()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--masks", "command"), 'add --phrase "the chair"'),
        (("--masks-run", "x {input} {output}", "--phrase", "a"), "--masks-run is for --masks"),
        (("--masks", "command", "--phrase", "a"), "add --masks-run"),
        (("--masks", "sam9", "--phrase", "a"), "choose one of command, clipseg"),
        (("--masks", "clipseg", "--masks-sam", "x", "--phrase", "a"), "take no --masks-sam"),
    ],
)
def test_options_that_do_not_fit(room, words, message):
    result = gsedit("select", room, *words, "--where", "opacity > 0.5", "-o", "x.npy")
    assert result.exit_code == 2
    assert message in result.stderr
