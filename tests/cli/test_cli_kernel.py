"""A command says once what renders, and refuses a kernel that there is not."""

from __future__ import annotations

import pytest
from command_line import gsedit, one_line

from rasterizer import compiled


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CXX", "/nowhere/c++")
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


def drawn(scene, out, *words):
    return gsedit("render", scene, "--count", 1, "--size", 16, "-o", out, *words)


def test_without_a_compiler_torch_renders_and_the_next_move_is_named(no_compiler, scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--json")
    assert result.exit_code == 0
    (line,) = (line for line in result.stderr.splitlines() if "renders" in line)
    assert line.startswith("no C++ compiler was found")
    assert "renders with torch, slower; name a C++17 compiler in CXX" in line
    assert "renders" not in result.stdout


def test_a_kernel_that_there_is_not_is_refused(no_compiler, scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--kernel", "compiled")
    assert result.exit_code == 2
    assert one_line(result.stderr.partition("gsedit: ")[2])
    assert "name a C++17 compiler in CXX" in result.stderr
    assert not (tmp_path / "a").exists()
