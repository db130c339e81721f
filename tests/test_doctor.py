"""Lines of the doctor about a machine, and about one that lacks something."""

from __future__ import annotations

import json

import pytest
import torch
from command_line import gsedit

from gsedit import doctor
from rasterizer import compiled


def test_the_doctor_on_the_machine(monkeypatch):
    monkeypatch.setattr(doctor, "_import_failure", lambda code: "ImportError: libusb-1.0.so.0")
    result = gsedit("doctor", "--json")
    assert result.exit_code == 0, result.stderr
    checks = {line["name"]: line for line in map(json.loads, result.stdout.splitlines())}
    assert {"gsedit", "python", "torch", "diffusers", "transformers", "threads", "memory",
            "compiled kernel", "open3d", "pyvista", "trimesh", "pycolmap", "av", "viser",
            "OpenEXR", "packages"} <= set(checks)  # fmt: skip
    assert checks["torch"]["state"].startswith(torch.__version__)
    assert f"{torch.get_num_threads()} of " in checks["threads"]["state"]
    assert checks["open3d"]["state"].endswith(", but ImportError: libusb-1.0.so.0")
    assert "--force-reinstall trimesh" in checks["trimesh"]["advice"]
    assert "apt-get install" in checks["open3d"]["advice"]
    result = gsedit("doctor")
    assert result.stderr.startswith("checking libraries")
    assert result.stderr.endswith(", marked ->\n")


def test_what_is_not_installed_is_advice(monkeypatch):
    monkeypatch.setattr(doctor, "installed_version", lambda package: None)
    advised = {check.name: check.advice for check in doctor.check_packages()}
    assert "pip install" in advised["diffusers"]
    assert "pip install numpy scipy" in advised["packages"]
    assert not advised["torch"]
    found = {check.name: check for check in doctor.check_libraries({})}
    assert found["av"].state == "not installed"
    assert found["av"].advice.endswith("needs it: pip install 'gsedit[video]'")


def test_a_build_for_cuda_is_told_how_to_get_the_small_one(monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", "12.8")
    check = doctor.check_torch()
    assert "built for CUDA 12.8, which gsedit does not use" in check.state
    version = torch.__version__.split("+")[0]
    assert f"pip install torch=={version} --index-url" in check.advice


def test_a_default_editor_without_weights_is_advice(monkeypatch, tmp_path):
    check = {check.name: check for check in doctor.check_packages()}["default editor"]
    assert (check.state, check.advice) == ("small", "")
    monkeypatch.setattr("gsedit.editors.small.WEIGHTS", tmp_path / "none.safetensors")
    check = {check.name: check for check in doctor.check_packages()}["default editor"]
    assert "install it again" in check.advice


def test_a_machine_without_a_compiler(monkeypatch):
    made = compiled.Made(None, "", "no C++ compiler was found")
    monkeypatch.setattr(compiled, "make", lambda source: made)
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
    assert check.state.startswith(f"{threads} of 2 processors")
    assert advice in check.advice
    assert bool(advice) == bool(check.advice)


@pytest.mark.parametrize("decided", [True, False])
def test_whether_steps_take_fewer_threads(monkeypatch, decided):
    monkeypatch.setattr("torch.get_num_threads", lambda: 2)
    monkeypatch.setattr("gsedit.runs.step_threads.is_decided", lambda: decided)
    monkeypatch.setattr("gsedit.runs.step_threads.waited_seconds", lambda: 0.0)
    assert ("steps take fewer" in doctor.check_threads().state) is not decided


def test_an_import_failure_is_the_last_line_of_another_process():
    assert doctor._import_failure("import json") == ""
    assert doctor._import_failure("raise ValueError('odd')") == "ValueError: odd"
    assert doctor._import_failure("import os; os._exit(7)") == "exit code 7"
