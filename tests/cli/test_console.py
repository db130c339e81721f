"""Text from files cannot command a terminal; where bars, lines and the kernel of C++ are."""

from __future__ import annotations

import sys
import warnings

import pytest
from bad_files import PLY_COLUMNS, ply_bytes, scene_table
from command_line import answer, gsedit
from gsedit_cli import main
from gsedit_cli.core.console import shown
from gsedit_cli.core.progress import NOTEBOOK, progress

from gsedit import Event
from rasterizer import compiled


def test_control_characters_are_shown_and_lines_stay_lines():
    assert shown("a\tb\nc é 世 \U0001f600") == "a\tb\nc é 世 \U0001f600"
    assert shown("\x1b[2J\x07\r\x9b\x7f") == "\\x1b[2J\\x07\\r\\x9b\\x7f"
    assert shown("\u202egnp.exe") == "\\u202egnp.exe"


def test_a_comment_of_a_scene_cannot_set_the_title(tmp_path):
    raw = ply_bytes(scene_table(), PLY_COLUMNS)
    raw = raw.replace(b"element vertex", b"comment \x1b]0;pwned\x07\nelement vertex", 1)
    (tmp_path / "a.ply").write_bytes(raw)
    done = gsedit("info", tmp_path / "a.ply")
    assert done.exit_code == 0
    assert "\\x1b]0;pwned\\x07" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


def test_warnings_of_libraries_are_not_printed(monkeypatch, capsys):
    monkeypatch.setattr(main, "app", lambda: warnings.warn("invalid value", stacklevel=1))
    monkeypatch.setattr(main.signal, "signal", lambda *_: None)
    with warnings.catch_warnings():
        warnings.resetwarnings()
        monkeypatch.setattr(main.sys, "warnoptions", [])
        main.main()
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("is_notebook", [False, True])
def test_a_terminal_gets_bars_and_a_notebook_lines(capsys, monkeypatch, is_notebook):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.delenv(NOTEBOOK, raising=False)
    if is_notebook:
        monkeypatch.setenv(NOTEBOOK, "1")
    with progress() as show:
        show(Event("fit", 0.0, 2, 2))
    assert ("[0 s] fit 2/2" in capsys.readouterr().err) == is_notebook


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CXX", "/nowhere/c++")
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


def test_without_a_compiler_torch_renders_and_only_its_kernel_is_refused(
    no_compiler, scene, tmp_path
):
    words = ("render", scene, "--count", 1, "--size", 16)
    answer(*words, "-o", tmp_path / "a")
    refused = gsedit(*words, "-o", tmp_path / "b", "--kernel", "compiled")
    assert refused.exit_code == 2
    assert "CXX" in refused.stderr
    assert not (tmp_path / "b").exists()
