"""Threads sleep after a short spin, but where the user or an earlier import of torch decides."""

import os
import subprocess
import sys

import pytest

import rasterizer as waiting


@pytest.fixture(autouse=True)
def undecided(monkeypatch):
    """No policy in the environment, and none decided; what a test decides does not last."""
    for name in waiting.POLICIES:
        monkeypatch.setenv(name, "")  # so that what is set meanwhile is undone
        monkeypatch.delenv(name)
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    waiting.wait_briefly.cache_clear()
    yield
    waiting.wait_briefly.cache_clear()


@pytest.mark.parametrize(
    ("name", "value"), [("GOMP_SPINCOUNT", "7"), ("OMP_WAIT_POLICY", "active")]
)
def test_the_user_decides(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    assert waiting.wait_briefly() == f"{name}={value}"
    assert [each for each in waiting.POLICIES if each in os.environ] == [name]


def test_after_torch_it_is_too_late(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", sys)
    assert waiting.wait_briefly() == ""
    assert "GOMP_SPINCOUNT" not in os.environ


@pytest.mark.parametrize("package", ["rasterizer", "gsedit", "gsedit_cli.main"])
def test_every_package_decides_before_torch_is_loaded(package):
    code = (
        f"import {package}, os, sys\n"
        "assert 'torch' not in sys.modules\n"
        f"assert os.environ['GOMP_SPINCOUNT'] == '{waiting.SPINS}'"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
