"""Editors by name: ours, and those of other packages."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import gsedit

from gsedit.errors import GseditError, UsageError
from gsedit.paper.editors import Editor, list_editors, make_editor, registry

THEIRS = '''
from gsedit.paper.editors import Capabilities


class Mirror:
    """Turns pictures round."""

    name, cell, capabilities = "mirror", 8, Capabilities()

    def __init__(self, model=None):
        self.model = model

    def check(self, prompt): ...

    def edit(self, batch, settings, generator): ...

    @staticmethod
    def missing():
        return ["a mirror: buy one"]


class Undeclared(Mirror):
    @property
    def capabilities(self):
        raise AttributeError


class Broken:
    def __init__(self):
        raise RuntimeError("no mirror\\nin here")


def nothing(**anything):
    return 3


number = 3
'''


def install(folder: Path, name: str, entries: str, code: str = "") -> None:
    """Files that pip installs of a package with entry points: metadata, and a module."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[gsedit.editors]\n{entries}\n")
    (folder / f"{name}.py").write_text(code)


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Two third-party packages, one of which cannot be imported."""
    entries = (
        "mirror = mirrors:Mirror\nbroken = mirrors:Broken\nnothing = mirrors:nothing\n"
        "undeclared = mirrors:Undeclared\nnumber = mirrors:number\n"
        "absent = mirrors:Absent\npix2pix = mirrors:Mirror"
    )
    install(tmp_path, "mirrors", entries, THEIRS)
    install(tmp_path, "torn", "torn = torn:Torn", "import surely_not_installed")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    for name in ("mirrors", "torn"):
        sys.modules.pop(name, None)


def test_ours_are_listed_with_what_they_need():
    ours = {listing.name: listing for listing in list_editors() if listing.source == "gsedit"}
    assert tuple(ours) == tuple(registry.EDITORS.ours)
    assert ours["painter"].ready
    assert ours["painter"].options == ("--like", "--strength", "--keep-colors")
    assert ours["closed-form"].ready
    assert not ours["closed-form"].options
    for name in ("pix2pix", "diffusers"):
        assert ours[name].options == ("--model", "--runtime")
    assert "black-forest-labs/FLUX.2-klein-4B" in ours["diffusers"].needs[-1]
    assert ours["command"].options == ("--run",)
    assert "{input} {output} {prompt}" in ours["command"].needs[0]
    assert all(listing.summary for listing in ours.values())
    assert isinstance(make_editor(), Editor)
    assert make_editor().name == "painter"


def test_listing_them_loads_no_torch():
    code = (
        "import sys, gsedit.paper.editors as e; e.list_editors(); assert 'torch' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_third_party_s_editor_is_made_and_listed(packages):
    assert "mirror" in registry.EDITORS.names()
    editor = make_editor("mirror", model="m", run=None, folder=Path("offered"))
    assert (editor.name, editor.model) == ("mirror", "m")
    (listing,) = (each for each in list_editors() if each.name == "mirror")
    assert listing.summary == "Turns pictures round."
    assert listing.source == "mirrors"
    assert listing.options == ("--model",)
    assert listing.needs == ("a mirror: buy one",)
    with pytest.raises(UsageError, match="no option --run: it takes --model"):
        make_editor("mirror", run="x")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("torn", r"torn editor \(torn\) cannot be made .*surely_not_installed.*remove torn"),
        ("absent", r"cannot be made .*no attribute 'Absent'"),
        ("number", "cannot be made"),
        ("broken", r"cannot be made \(RuntimeError: no mirror in here\): reinstall or rem"),
        ("nothing", "is none: it has no name, no cell, no check, no edit, no cap"),
        ("undeclared", "is none: it has no capabilities"),
    ],
)
def test_a_third_party_s_mistake_is_theirs_and_no_crash(packages, name, message):
    with pytest.raises(GseditError, match=message):
        make_editor(name)


def test_the_list_survives_them_all(packages):
    listings = [each for each in list_editors() if each.source != "gsedit"]
    found = {each.name: each for each in listings}
    assert set(found) == {
        *("mirror", "undeclared", "broken", "nothing", "number", "absent", "pix2pix", "torn")
    }
    assert "surely_not_installed" in found["torn"].needs[0]
    assert "taken" in found["pix2pix"].needs[0]  # ours has the right of way
    assert make_editor.__module__ == "gsedit.paper.editors.registry"
    result = gsedit("list", "editors", "--json")
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert {line["name"] for line in lines} == {*registry.EDITORS.ours, *found}
    assert next(line["name"] for line in lines if line["ready"]) == "painter"
    result = gsedit("list", "editors")
    assert result.exit_code == 0
    assert "torn         not ready (from torn)" in result.stdout
    assert "Traceback" not in result.output
