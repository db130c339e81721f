"""Staged scenes: laws of the changes, and Gaussians that follow them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from bench.staged import stage, stages
from bench.staged.sets import FLOOR

from gsedit.bench.synthetic.paint import plain
from gsedit.scene.similarity import IDENTITY, Similarity
from rasterizer import render

COUNT, SIZE = 800, 32


@pytest.fixture(scope="module")
def meadow():
    return stage("meadow")


@pytest.fixture(scope="module")
def given(meadow):
    return meadow.gaussians(COUNT)


def test_every_stage_shows_its_things_to_a_training_and_a_held_out_camera():
    for each in stages():
        names = {i: thing.name for i, thing in enumerate(each.everything)}
        assert len(set(names.values())) == len(names)
        for cameras in (each.training(16), each.held_out(16)):
            seen = {i for camera in cameras[:3] for i in each.label_map(camera).unique().tolist()}
            assert {thing.name for thing in each.things} <= {names.get(i) for i in seen}


def test_boxes_hold_the_things_and_touch_them(meadow):
    for thing in (*meadow.things, *stage("table").things, *stage("corner").things):
        middle = 0.5 * (np.array(thing.low) + np.array(thing.high))
        for axis in range(3):
            for end in (thing.low, thing.high):
                face = torch.from_numpy(middle)
                face[axis] = end[axis]
                across = torch.linspace(-0.5, 0.5, 41).double()
                u, v = torch.meshgrid(across, across, indexing="ij")
                plane = face.repeat(41, 41, 1)
                others = [i for i in range(3) if i != axis]
                plane[..., others[0]] += u * (thing.high[others[0]] - thing.low[others[0]])
                plane[..., others[1]] += v * (thing.high[others[1]] - thing.low[others[1]])
                assert 0 <= float(thing.solid(plane).min()) + 1e-9 < 0.02


def test_without_a_thing_no_shadow_of_it_is_left_and_nothing_else_changes(meadow):
    bare = meadow.without("red ball")
    camera = meadow.held_out(SIZE)[0]
    before, after = meadow.photo(camera, 1), bare.photo(camera, 1)
    assert not bare.mask(camera, "grass")[~(meadow.mask(camera, "grass", "red ball"))].any()
    changed = (before - after).abs().amax(-1) > 1e-6
    shadow = changed & ~meadow.mask(camera, "red ball")
    assert shadow.any()
    assert not changed[meadow.label_map(camera) == -1].any()
    assert (after[shadow].mean(-1) >= before[shadow].mean(-1)).all()
    with pytest.raises(KeyError):
        meadow.without("green ball")


def test_moving_back_gives_the_same_picture(meadow):
    quarter = np.array(((0.0, -1, 0), (1, 0, 0), (0, 0, 1)))
    away = Similarity(quarter, 1.3, np.array((0.3, -0.2, 0.1)))
    camera = meadow.held_out(SIZE)[0]
    there = meadow.moved("blue post", away)
    back = there.moved("blue post", away.inverse)
    assert there.thing("blue post").height == pytest.approx(1.3 * 0.6)
    assert torch.allclose(back.photo(camera, 1), meadow.photo(camera, 1), atol=1e-5)
    assert (there.photo(camera, 1) - meadow.photo(camera, 1)).abs().max() > 0.1
    assert there.moved("blue post", IDENTITY).thing("blue post").low == pytest.approx(
        there.thing("blue post").low
    )


def test_another_color_stays_on_its_thing(meadow):
    camera = meadow.held_out(SIZE)[0]
    ball = replace(meadow.thing("red ball"), coat=plain((0.1, 0.3, 0.8)))
    new = meadow.with_thing(ball).photo(camera, 1)
    difference = (new - meadow.photo(camera, 1)).abs().amax(-1)
    assert difference[~meadow.mask(camera, "red ball")].max() < 0.02
    assert difference[meadow.mask(camera, "red ball")].median() > 0.2


def test_snow_lies_on_level_ground_at_its_thickness_and_not_beneath_a_ball(meadow):
    solid = meadow.snowed(0.05).scene.sdf
    x, y = torch.tensor((-0.12, 0.6)), torch.tensor((0.0, -0.6))
    ground = torch.stack((x, y, torch.full((2,), FLOOR + 0.05)), -1).double()
    assert solid(ground)[1].abs() < 1e-7  # the points are float32
    beneath = torch.tensor((-0.12, 0.2, FLOOR + 0.02)).double()[None]
    assert solid(beneath) > 0.01
    only = meadow.snowed(0.05, "red ball").scene.sdf
    assert only(ground)[1] == pytest.approx(0.05, abs=1e-6)


def test_bent_points_lie_on_the_bent_thing_and_its_foot_stays(meadow):
    post = meadow.thing("blue post")
    x, y, _ = post.foot
    angle = torch.linspace(0, 6.28, 20)
    points = torch.stack((x + 0.07 * angle.cos(), y + 0.07 * angle.sin(), 0.02 * angle - 0.3), -1)
    assert post.solid(points.double()).abs().max() < 1e-7
    bent = post.bend_points(points.double(), 60.0)
    assert post.bent(60.0).solid(bent).abs().max() < 1e-7
    foot = torch.from_numpy(post.foot)[None]
    assert torch.equal(post.bend_points(foot, 60.0), foot)


def test_gaussians_know_their_thing_and_are_kept_where_nothing_changed(meadow, given):
    assert set(given.labels.tolist()) == {0, 1, 2}
    low = given.scene.means[given.of("red ball")].amin(0)
    assert (low > torch.tensor(meadow.thing("red ball").low) - 0.01).all()
    same, origin = meadow.gaussians_from(meadow, given, COUNT)
    assert torch.equal(origin, torch.arange(len(given.scene)))
    assert torch.equal(same.scene.sh, given.scene.sh)


def test_gaussians_without_a_thing_close_the_hole(meadow, given):
    bare = meadow.without("red ball")
    left, origin = bare.gaussians_from(meadow, given, COUNT)
    old = origin >= 0
    assert torch.equal(left.scene.means[old], given.scene.means[origin[old]])
    assert not given.of("red ball")[origin[old]].any()
    camera = meadow.training(SIZE)[9]
    hole = meadow.mask(camera, "red ball") & bare.mask(camera, "grass")
    assert hole.any()
    assert render(left.scene, camera).alpha[hole].min() > 0.8
