"""Text from files cannot command a terminal."""

from __future__ import annotations

import warnings

from bad_files import PLY_COLUMNS, ply_bytes, scene_table
from command_line import gsedit
from gsedit_cli import main
from gsedit_cli.core.console import shown


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
