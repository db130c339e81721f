"""Shells complete verbs, options and values."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

CODE = "import sys; sys.argv = ['gsedit']; from gsedit_cli.main import main; main()"


def asked(**variables: str) -> str:
    """Ask as a shell does; return the answer."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **variables},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("gsedit ed", ["edit"]),
        ("gsedit edit --se", ["--seed", "--set"]),
        ("gsedit fit photos --quality ", ["draft", "normal", "high"]),
    ],
)
def test_bash_is_told_what_may_follow(words, found):
    number = str(len(words.split(" ")) - 1)
    said = asked(COMP_WORDS=words, COMP_CWORD=number, _GSEDIT_COMPLETE="complete_bash")
    assert said.split() == found


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_its_script(shell):
    assert "_GSEDIT_COMPLETE" in asked(_GSEDIT_COMPLETE=f"source_{shell}")
