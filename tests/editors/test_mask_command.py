"""A program as a mask provider: folders, phrases and failures."""

from __future__ import annotations

import shlex

import pytest
import torch

from gsedit.errors import GseditError, InputError
from gsedit.paper.editors import make_masks
from gsedit.paper.editors.command import MaskCommand

RED = """
import sys
from pathlib import Path
from PIL import Image
source, target, phrase = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
(Path(__file__).parent / "phrase.txt").write_text(phrase)
for path in sorted(source.iterdir()):
    red, green, _ = Image.open(path).split()
    mask = red.point(lambda value: 255 if value > 128 else 0)
    mask.resize((2 * mask.width, 2 * mask.height), 0).save(target / path.name)
"""
FAILS = "import sys; print('no weights', file=sys.stderr); sys.exit(3)"
NOTHING = ""
SQUARE = """
import sys
from pathlib import Path
from PIL import Image
for path in Path(sys.argv[1]).iterdir():
    Image.new("L", (9, 9)).save(Path(sys.argv[2]) / path.name)
"""


def command(tmp_path, code: str) -> MaskCommand:
    program = tmp_path / "a program.py"
    program.write_text(code)
    words = f"{{python}} {shlex.quote(str(program))} {{input}} {{output}} {{phrase}}"
    return make_masks("command", run=words)


def pictures(count: int = 2):
    g = torch.Generator().manual_seed(0)
    return [torch.rand(10, 16, 3, generator=g) for _ in range(count)]


def test_its_masks_are_probabilities_of_the_pictures_size(tmp_path):
    shown = pictures()
    provider = command(tmp_path, RED)
    provider.check("the red 'one'; rm -rf /")
    found = list(provider.masks(shown, "the red 'one'; rm -rf /"))
    for mask, picture in zip(found, shown, strict=True):
        levels = (255 * picture[..., 0]).round()
        torch.testing.assert_close(mask, (levels > 128).float())
    assert (tmp_path / "phrase.txt").read_text() == "the red 'one'; rm -rf /"


@pytest.mark.parametrize(
    ("code", "kind", "message"),
    [
        (FAILS, GseditError, r"ended with code 3; it said: no weights\. 0 of 2 pictures"),
        (NOTHING, InputError, "made no 000.png"),
        (SQUARE, InputError, "is 9x9 and its view 16x10"),
    ],
)
def test_what_a_program_does_wrong_is_told(tmp_path, code, kind, message):
    with pytest.raises(kind, match=message):
        list(command(tmp_path, code).masks(pictures(), "red"))
