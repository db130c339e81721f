"""The paint route on exact subjects: a matte ball in a garden, and the same ball alone."""

import numpy as np
import pytest
import torch
from bench.reflective import Finish, plain_base
from changes import painted

from gsedit.bench.synthetic import ring_cameras
from gsedit.errors import UsageError
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.words.instruction import Change
from rasterizer.numerics import SH_DC
from rasterizer.render import render_picture

ASKED = ("#653700", "#029386", "#e50000", "#ffffff", "#0343df", "#808080", "#fac205")


def paint(name, color):
    return Change("subject", "paint", name, color, None, "paint")


def distance(one, other):
    """Distance in CIE Lab, of which 2.3 is just seen."""
    return float(np.linalg.norm(lab_of_srgb(one) - lab_of_srgb(other)))


def test_the_mean_is_that_of_the_color_in_the_scenes_light(ball):
    lit, scene, own, cameras = ball
    held_out = ring_cameras(lit.solid, 1, 32, elevation=33.0, start=-20.0)[0]
    hit = lit.solid.trace(held_out).hit
    found = []
    for color in ASKED:
        truth = Finish(plain_base(tuple(srgb_of_hex(color).tolist())), specular=0.0)
        exact = lit.photograph(truth, held_out, 24, 1)[hit].mean(0).numpy()
        after = painted(scene, paint("", color), own, cameras).scene
        shown = render_picture(after, held_out)[hit].mean(0).double().numpy()
        found.append(distance(shown, exact))
    assert np.median(found) < 8
    assert max(found) < 18


def test_alone_it_is_near_the_color_asked_for(ball):
    _, scene, own, _ = ball
    alone = scene[own]
    after = painted(alone, paint("teal", "#029386"), torch.ones(len(alone)).bool()).scene
    shown = (0.5 + SH_DC * after.sh[:, 0]).clamp(0, 1).mean(0).double().numpy()
    assert distance(shown, srgb_of_hex("#029386")) < 15


def test_outside_the_bits_are_the_same_and_the_degree_stays(ball):
    _, scene, own, cameras = ball
    after = painted(scene, paint("red", "#e50000"), own, cameras).scene
    assert after.degree == scene.degree
    assert torch.equal(after.sh[~own], scene.sh[~own])
    assert not torch.equal(after.sh[own], scene.sh[own])


def test_a_finish_decides_what_depends_on_the_direction(ball):
    _, scene, own, cameras = ball
    shine = {}
    for finish in ("matte", "glossy", "metallic"):
        change = paint(f"{finish} teal", "#029386")
        outcome = painted(scene, change, own, cameras)
        shine[finish] = float(outcome.scene.sh[own[outcome.origin], 1:].abs().sum())
    assert shine["matte"] == 0
    assert min(shine["glossy"], shine["metallic"]) > 0


def test_a_region_of_nothing_and_a_color_that_is_none_are_refused(ball):
    _, scene, own, _ = ball
    with pytest.raises(UsageError, match="--region"):
        painted(scene, paint("teal", "#029386"), torch.zeros_like(own))
    with pytest.raises(UsageError, match="#008080"):
        painted(scene, paint("teal", None), own)
