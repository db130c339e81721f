"""Lines of the doctor about a machine, and about one that lacks something."""

import json

import torch
from command_line import gsedit

from gsedit import doctor


def test_the_doctor_on_the_machine(monkeypatch):
    monkeypatch.setattr(doctor, "_import_failure", lambda code: "ImportError: libusb-1.0.so.0")
    result = gsedit("doctor", "--json")
    assert result.exit_code == 0, result.stderr
    checks = {line["name"]: line for line in map(json.loads, result.stdout.splitlines())}
    assert {"gsedit", "python", "torch", "diffusers", "transformers", "openvino",
            "compiled kernel", "open3d", "pyvista", "trimesh", "pycolmap", "av", "viser",
            "OpenEXR", "packages"} <= set(checks)  # fmt: skip
    assert checks["torch"]["state"].startswith(torch.__version__)
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
