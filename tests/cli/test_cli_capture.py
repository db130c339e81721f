"""The last lines of `gsedit capture`."""

from __future__ import annotations

from pathlib import Path

import pytest
from gsedit_cli.options.common import Seeded
from gsedit_cli.verbs.capture import print_capture, settings_from

from gsedit.capture.capture import CaptureResult


def result(focals):
    return CaptureResult(".", 4, 4, (4,), 0.5, 900, focals, "gravity", (), (), 3.0)


def test_the_next_command_can_be_typed_as_it_is(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "my scene"
    folder.mkdir()
    monkeypatch.chdir(folder)
    focals = tuple((20.0 + i, "EXIF 35 mm") for i in range(9))
    print_capture(result(focals), Path())
    posed, focal, then = capsys.readouterr().err.splitlines()
    assert posed.startswith("4 of 4 photos posed, ")
    assert "22 mm (EXIF 35 mm, refined) and 6 more; upright by gravity" in focal
    assert then == "next:  gsedit fit . -o 'my scene.ply'"  # and no picture that is not there
    (folder / "capture.png").touch()
    print_capture(result(focals), folder)
    *_, look, then = capsys.readouterr().err.splitlines()
    assert look == f"look:  {folder / 'capture.png'}"
    assert then == f"next:  gsedit fit '{folder}' -o 'my scene.ply'"


@pytest.mark.parametrize("seed", [0, 7, -1, 2**40 + 7])
def test_any_seed_is_one_that_colmap_takes(seed):
    assert settings_from({}, Seeded(seed=seed)).seed == seed % 2**31
