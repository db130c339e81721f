"""Every error is one line and an exit code, and no output is overwritten by accident."""

from __future__ import annotations

import pytest
from bad_files import BAD_FILES, BadFile
from command_line import files, gsedit, one_line
from gsedit_cli.core.exits import Interrupted

from gsedit.errors import GseditError, InputError, UsageError


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (UsageError("odd request"), 2, "odd request"),
        (InputError("odd file"), 3, "odd file"),
        (GseditError("odd"), 1, "odd"),
        (Interrupted("stopped at 3"), 130, "stopped at 3"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "--size"),
        (OSError(28, "No space left on device", "x.ply"), 1, "x.ply: No space left"),
        (ValueError("two\nlines"), 1, "ValueError: two lines); rerun with --debug"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_every_error_is_one_line_and_its_code(monkeypatch, scene, error, code, words):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("gsedit.formats.registry.open_scene", fail)
    result = gsedit("info", scene)
    assert result.exit_code == code
    assert one_line(result.stderr)
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def test_debug_shows_the_traceback_and_the_line(tmp_path):
    result = gsedit("info", tmp_path / "none.ply", "--debug")
    assert result.exit_code == 3
    assert "Traceback" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("gsedit: ")


@pytest.mark.parametrize("bad", BAD_FILES, ids=lambda bad: bad.name)
def test_bad_input_is_one_line_3_and_nothing_written(bad: BadFile, tmp_path):
    path = bad.build(tmp_path)
    before = files(tmp_path)
    out = tmp_path / "new"
    if bad.kind == "scene":
        result = gsedit("edit", path, "make it snow", "-o", out)
    else:
        result = gsedit("fit", path, "-o", out / "scene.ply", "--kernel", "torch")
    assert result.exit_code in (2, 3)
    assert one_line(result.stderr)
    for words in bad.words:
        assert words in result.stderr
    assert files(tmp_path) == before
    assert not out.exists()
