"""A machine without a C++ compiler."""

from __future__ import annotations

import pytest
from command_line import answer, gsedit

from rasterizer import compiled


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CXX", "/nowhere/c++")
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


def test_without_a_compiler_torch_renders_and_only_an_explicit_wish_is_refused(
    no_compiler, scene, tmp_path
):
    words = ("render", scene, "--count", 1, "--size", 16)
    answer(*words, "-o", tmp_path / "a")
    refused = gsedit(*words, "-o", tmp_path / "b", "--kernel", "compiled")
    assert refused.exit_code == 2
    assert "CXX" in refused.stderr
    assert not (tmp_path / "b").exists()
