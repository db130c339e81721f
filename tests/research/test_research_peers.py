"""Other renderers get the scene as their documentation asks."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from research.renderer import peers
from research.renderer.workloads import cloud
from scenes import camera, random_cloud

from gsedit.bench.renderer import accuracy, speed


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_gsplat_is_called_as_its_documentation_says(monkeypatch):
    """With our own function of the same contract in its place, the picture is ours."""
    rasterization = pytest.importorskip("rasterizer.rasterization").rasterization
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    one = speed.Workload("cloud", random_cloud(40, 0, degree=1).to(torch.float32), camera())
    measured = peers.measure_peer("gsplat", one, runs=1, budget=1.0, pieces=1)
    wanted = accuracy.reference_of(one.scene, one.camera)
    got = accuracy.errors(measured.drawn, wanted)
    assert got.mean < 5e-6  # the bar of the default stop
    assert got.gradient < 2e-4
    assert measured.both.wall > 0


def test_mitsuba_gets_the_scene_in_its_own_format(tiny):
    mi = SimpleNamespace(TensorXf=np.asarray, ScalarTransform4f=np.asarray)
    shifted = replace(tiny.camera, cx=tiny.camera.cx + 6)
    words = peers.mitsuba_scene(mi, replace(tiny, camera=shifted))
    sensor, splats = words["sensor"], words["primitives"]
    assert sensor["principal_point_offset_x"] == pytest.approx(-6 / 24)
    assert math.tan(math.radians(sensor["fov"] / 2)) == pytest.approx(12 / shifted.fx)
    forward = sensor["to_world"] @ np.array([0, 0, 1, 0])
    assert np.allclose(forward[:3], shifted.forward)
    assert splats["quaternions"].shape == (60, 4)
    w = splats["quaternions"][:, 3] * tiny.scene.quats.norm(dim=1).numpy()
    assert np.allclose(w, tiny.scene.quats[:, 0], atol=1e-6)  # real part last; float32
    assert np.allclose(splats["opacities"][:, 0], tiny.scene.opacities)
