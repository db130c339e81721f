"""A program as a mask provider: folders, phrases and failures."""

from __future__ import annotations

import shlex
from importlib.metadata import EntryPoint

import pytest
import torch

from gsedit.editors import make_masks
from gsedit.editors.command.editor import MaskCommand
from gsedit.errors import GseditError, InputError, UsageError

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


@pytest.mark.parametrize(
    ("run", "message"),
    [
        ("segment {input}", r"--masks-run has no \{output\}.*as in --masks-run \"my_segmenter"),
        ("segment {input} {output} {prompt}", r"knows no \{prompt\}, only \{input\}"),
        ("'segment {input} {output}", "cannot be split"),
    ],
)
def test_commands_that_are_none(run, message):
    with pytest.raises(UsageError, match=message):
        make_masks("command", run=run)


def test_a_program_that_is_not_there():
    provider = make_masks("command", run="no-such-program {input} {output}")
    with pytest.raises(UsageError, match=r"no program 'no-such-program'.*--masks-run"):
        provider.check("red")


def test_providers_by_name(monkeypatch):
    other = EntryPoint("known", "gsedit.editors.command.editor:MaskCommand", "gsedit.masks")
    monkeypatch.setattr("gsedit.editors.plugins.entry_points", lambda group: [other])
    assert isinstance(make_masks("known", run="segment {input} {output}"), MaskCommand)
    with pytest.raises(UsageError, match="choose one of command, clipseg, grounded-sam, known"):
        make_masks("sam9")
    with pytest.raises(UsageError, match="the known masks has no option --masks-model"):
        make_masks("known", model="folder", run=None)
    for name, needed in (("command", "run"), ("clipseg", "model"), ("grounded-sam", "sam")):
        with pytest.raises(UsageError, match=f"--masks-{needed}"):
            make_masks(name)
