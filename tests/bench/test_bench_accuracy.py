"""Errors of pictures and gradients; the reference's file."""

from __future__ import annotations

from importlib import import_module

import pytest
from benchmarks import cloud

from gsedit.bench.renderer import accuracy, speed
from rasterizer import render
from rasterizer.blending.choose import is_compiled
from rasterizer.cpp_projection import picture
from rasterizer.numerics import AUTO


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_what_is_measured_is_what_renders_by_default(tiny, monkeypatch):
    """The compiled front end, where there is one: not what stands in for it."""
    if not is_compiled(AUTO):
        pytest.skip("no C++ compiler on this machine")
    drawn = []

    def spy(*args, **kwargs):
        drawn.append(picture.draw(*args, **kwargs) is not None)
        return picture.draw(*args, **kwargs)

    monkeypatch.setattr(import_module("rasterizer.render"), "draw", spy)

    def colors(scene, camera):
        return render(scene, camera).color

    found = accuracy.differentiate(colors, tiny.scene, tiny.camera)
    assert drawn == [True]
    assert set(found.gradients) == set(accuracy.FIELDS)
    both = accuracy.with_pose(found, colors, tiny.scene, tiny.camera)
    assert drawn == [True, False]
    assert set(both.gradients) == {*accuracy.FIELDS, accuracy.POSE}
    assert all(both.gradients[name] is found.gradients[name] for name in accuracy.FIELDS)
    assert both.gradients[accuracy.POSE].norm() > 0
