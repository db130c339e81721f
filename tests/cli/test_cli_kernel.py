"""A command says once what renders, and refuses a kernel that there is not."""

from __future__ import annotations

import pytest
from command_line import gsedit, one_line

from rasterizer import compiled
from rasterizer.blending import cpp_backend


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
    assert "renders with torch, slower; install g++" in line
    assert "renders" not in result.stdout


def test_a_kernel_that_there_is_not_is_refused(no_compiler, scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--kernel", "compiled")
    assert result.exit_code == 2
    assert one_line(result.stderr.partition("gsedit: ")[2])
    assert "install g++" in result.stderr
    assert not (tmp_path / "a").exists()


def test_the_kernel_is_named_once_and_torch_not_at_all(scene, tmp_path):
    if compiled.make(cpp_backend.SOURCE).failure:
        pytest.skip("no C++ compiler on this machine")
    assert drawn(scene, tmp_path / "a").stderr.count("renders with the compiled kernel (") == 1
    assert "renders" not in drawn(scene, tmp_path / "b", "--kernel", "torch").stderr


def test_the_option_of_before_is_told_what_became_of_it(scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--compile")
    assert result.exit_code == 2
    assert "--kernel torch does without it" in result.stderr
