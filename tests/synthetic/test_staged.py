"""Staged scenes: laws of the changes, and Gaussians that follow them."""

import numpy as np
import pytest
import torch
from bench.staged import stage, stages
from bench.staged.sets import FLOOR

COUNT, SIZE = 800, 32


@pytest.fixture(scope="module")
def meadow():
    return stage("meadow")


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


def test_snow_lies_on_level_ground_at_its_thickness_and_not_beneath_a_ball(meadow):
    solid = meadow.snowed(0.05).scene.sdf
    x, y = torch.tensor((-0.12, 0.6)), torch.tensor((0.0, -0.6))
    ground = torch.stack((x, y, torch.full((2,), FLOOR + 0.05)), -1).double()
    assert solid(ground)[1].abs() < 1e-7  # the points are float32
    beneath = torch.tensor((-0.12, 0.2, FLOOR + 0.02)).double()[None]
    assert solid(beneath) > 0.01
    only = meadow.snowed(0.05, "red ball").scene.sdf
    assert only(ground)[1] == pytest.approx(0.05, abs=1e-6)
