"""Progress as lines of a log."""

from __future__ import annotations

import sys

import pytest
from gsedit_cli.core.progress import NOTEBOOK, progress

from gsedit import Event


def test_a_log_is_a_line_a_stage_and_now_and_then(capsys):
    with progress(as_json=False) as show:
        for second in range(100):
            show(Event("fit", float(second), second + 1, 100))
        show(Event("measure", 100.0, error=0.1))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("[0 s] fit 1/100")
    assert lines[-1] == "[100 s] measure 20.00 dB"
    assert len(lines) == 1 + 9 + 1 + 1  # first, every 10 seconds, last, and the other stage


@pytest.mark.parametrize("is_notebook", [False, True])
def test_a_terminal_gets_bars_and_a_notebook_lines(capsys, monkeypatch, is_notebook):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.delenv(NOTEBOOK, raising=False)
    if is_notebook:
        monkeypatch.setenv(NOTEBOOK, "1")
    with progress(as_json=False) as show:
        show(Event("fit", 0.0, 2, 2))
    assert ("[0 s] fit 2/2" in capsys.readouterr().err) == is_notebook
