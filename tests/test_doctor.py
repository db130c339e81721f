"""What the doctor says of a machine, and of one that lacks something."""

from __future__ import annotations

import json
import warnings

import pytest
import torch
from command_line import gsedit

from gsedit import doctor
from gsedit.errors import GseditError


def test_the_doctor_on_the_machine(monkeypatch):
    monkeypatch.setattr(doctor, "_draw", lambda: None)  # viewers have tests of their own
    monkeypatch.setattr(doctor, "_import_failure", lambda code: "ImportError: libusb-1.0.so.0")
    result = gsedit("doctor", "--json")
    assert result.exit_code == 0, result.stderr
    checks = {line["name"]: line for line in map(json.loads, result.stdout.splitlines())}
    assert {"gsedit", "python", "torch", "diffusers", "transformers", "threads", "memory",
            "compiled kernel", "open3d", "pyvista"} <= set(checks)  # fmt: skip
    assert checks["torch"]["state"].startswith(torch.__version__)
    assert f"{torch.get_num_threads()} of " in checks["threads"]["state"]
    assert checks["open3d"]["state"] == "ImportError: libusb-1.0.so.0"
    assert "apt-get install" in checks["open3d"]["advice"]
    assert gsedit("doctor").stderr.endswith(", marked ->\n")


def test_what_is_not_installed_is_advice(monkeypatch):
    monkeypatch.setattr(doctor, "installed_version", lambda package: None)
    advised = {check.name: check.advice for check in doctor.check_packages()}
    assert "pip install" in advised["diffusers"]
    assert not advised["torch"]


def test_a_default_editor_without_weights_is_advice(monkeypatch, tmp_path):
    check = {check.name: check for check in doctor.check_packages()}["default editor"]
    assert (check.state, check.advice) == ("small", "")
    monkeypatch.setattr("gsedit.editors.small.WEIGHTS", tmp_path / "none.safetensors")
    check = {check.name: check for check in doctor.check_packages()}["default editor"]
    assert "install it again" in check.advice


def test_a_machine_without_a_compiler(monkeypatch):
    def load():
        warnings.warn("no C++ compiler was found: install g++", stacklevel=2)

    monkeypatch.setattr("rasterizer.blending.cpp_backend.load", load)
    check = doctor.check_compiler()
    assert "slower" in check.state
    assert "install g++" in check.advice


@pytest.mark.parametrize(("free", "advised"), [(int(2e9), True), (int(8e9), False)])
def test_little_memory_is_advice(monkeypatch, free, advised):
    monkeypatch.setattr("gsedit.diffusion.memory.free_bytes", lambda: free)
    check = doctor.check_memory()
    assert check.state == f"{free / 1e9:.1f} GB free"
    assert bool(check.advice) == advised


@pytest.mark.parametrize(
    ("threads", "limit", "advice"),
    [(8, None, "add --threads 2"), (1, "1", "OMP_NUM_THREADS=1 leaves"), (2, None, "")],
)
def test_threads_that_do_not_fit_the_processors(monkeypatch, threads, limit, advice):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)
    monkeypatch.setattr("torch.get_num_threads", lambda: threads)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if limit:
        monkeypatch.setenv("OMP_NUM_THREADS", limit)
    check = doctor.check_threads()
    assert check.state == f"{threads} of 2 processors"
    assert advice in check.advice
    assert bool(advice) == bool(check.advice)


def test_a_viewer_that_cannot_draw(monkeypatch):
    def fail():
        raise GseditError("pyvista finds no OpenGL")

    monkeypatch.setattr(doctor, "_draw", fail)
    monkeypatch.setattr(doctor, "_import_failure", lambda code: "")
    _, drawn = doctor.check_viewers()
    assert drawn.state == "does not draw"
    assert "no OpenGL" in drawn.advice


def test_an_import_failure_is_the_last_line_of_another_process():
    assert doctor._import_failure("import json") == ""
    assert doctor._import_failure("raise ValueError('odd')") == "ValueError: odd"
    assert doctor._import_failure("import os; os._exit(7)") == "exit code 7"
