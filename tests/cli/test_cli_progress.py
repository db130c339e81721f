"""Progress as lines of a log."""

from __future__ import annotations

import sys

import pytest
from gsedit_cli.core.progress import NOTEBOOK, progress

from gsedit import Event


@pytest.mark.parametrize("is_notebook", [False, True])
def test_a_terminal_gets_bars_and_a_notebook_lines(capsys, monkeypatch, is_notebook):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.delenv(NOTEBOOK, raising=False)
    if is_notebook:
        monkeypatch.setenv(NOTEBOOK, "1")
    with progress(as_json=False) as show:
        show(Event("fit", 0.0, 2, 2))
    assert ("[0 s] fit 2/2" in capsys.readouterr().err) == is_notebook
