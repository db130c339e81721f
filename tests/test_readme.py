"""README.md: its first command leads to `gsedit` on the PATH, in one line."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_the_line_after_the_first_command_reaches_gsedit(tmp_path):
    text = (ROOT / "README.md").read_text()
    line = re.search(r"^ *(source \.venv/bin/activate)\b", text, re.MULTILINE)
    assert line, "README.md does not say how to reach gsedit after make demo"
    assert text.index("make demo") < line.start()
    if not (Path(sys.prefix) / "bin/activate").is_file():
        pytest.skip("python does not run in a virtual environment here")
    (tmp_path / ".venv").symlink_to(sys.prefix)
    words = ["bash", "-c", f"PATH=/usr/bin:/bin; {line[1]} && gsedit --help"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "gsedit VERB --help" in done.stdout


def test_the_demo_ends_with_that_line():
    recipe = (ROOT / "Makefile").read_text().split("\ndemo:")[1].split("\n\n")[0]
    assert "source .venv/bin/activate" in recipe.splitlines()[-1]
