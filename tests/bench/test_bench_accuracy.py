"""Errors of pictures and gradients."""

from __future__ import annotations

import math
from importlib import import_module

import pytest
import torch
from benchmarks import cloud
from closeness import with_pose

from gsedit.bench.renderer import accuracy, speed
from rasterizer import render
from rasterizer.blending.choose import is_compiled
from rasterizer.cpp_projection import picture
from rasterizer.numerics import AUTO


@pytest.fixture
def tiny() -> speed.Workload:
    return cloud(60, 24, 16)


def test_picture_errors_are_mean_tail_and_largest():
    expected = torch.zeros(100, 10, 3)
    drawn = expected.clone()
    drawn[0, 0, 0], drawn[5, 5, 1] = -0.5, 0.25
    found = accuracy.errors(accuracy.Drawn(drawn, {}), accuracy.Drawn(expected, {}))
    assert found.mean == pytest.approx(0.75 / 3000)
    assert (found.largest, found.gradient) == (0.5, None)


def test_the_worst_gradient_counts():
    picture = torch.zeros(2, 2, 3)
    expected = {"a": torch.tensor([3.0, 4.0]), "b": torch.tensor([1.0, 0.0])}
    drawn = {"a": torch.tensor([3.0, 4.5]), "b": torch.tensor([0.0, 1.0])}
    got = accuracy.errors(accuracy.Drawn(picture, drawn), accuracy.Drawn(picture, expected))
    assert got.gradient == pytest.approx(math.sqrt(2))
    alone = accuracy.Drawn(picture, {"a": drawn["a"]})
    assert accuracy.errors(alone, accuracy.Drawn(picture, expected)).gradient == pytest.approx(0.1)


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
    both = with_pose(found, colors, tiny.scene, tiny.camera)
    assert drawn == [True, False]
    assert set(both.gradients) == {*accuracy.FIELDS, accuracy.POSE}
    assert all(both.gradients[name] is found.gradients[name] for name in accuracy.FIELDS)
    assert both.gradients[accuracy.POSE].norm() > 0
