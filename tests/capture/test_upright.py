"""The upright frame: whatever frame a reconstruction came in, the same cameras stand upright."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gsedit.capture.upright import find_upright


def held(yaw, pitch, roll=0.0, quarter=0):
    """A world-to-camera rotation: y of the world is down; degrees; pitch > 0 looks down. `quarter`:
    the picture lies on its side."""
    turn = Rotation.from_euler("y", yaw, degrees=True)
    tip = Rotation.from_euler("x", -pitch, degrees=True)
    lean = Rotation.from_euler("z", roll + 90 * quarter, degrees=True)
    return (turn * tip * lean).inv().as_matrix()


def cameras(rotations):
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3] = rotations
    return poses


def seen_from(world: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Cameras of the same pictures in a world that was turned."""
    poses = poses.copy()
    poses[:, :3, :3] = poses[:, :3, :3] @ world.T
    return poses


def tilt(poses, gravities=None) -> float:
    """Degrees between true down and what is found, the world being turned at random."""
    world = Rotation.random(random_state=3).as_matrix()
    unknown = np.full((len(poses), 3), np.nan)
    gravities = unknown if gravities is None else gravities
    found = find_upright(seen_from(world, poses), gravities)[0]
    assert np.allclose(found @ found.T, np.eye(3))
    assert np.linalg.det(found) == pytest.approx(1)
    down = found @ world @ np.array([0, 1.0, 0])
    return float(np.degrees(np.arccos(np.clip(down[1], -1, 1))))


ORBIT = [held(yaw, 25) for yaw in range(0, 360, 15)]
HALF = [held(yaw, 25) for yaw in range(0, 180, 15)]
FORWARD = [held(yaw, pitch) for yaw in (-4, 0, 4) for pitch in (-5, 0, 5)]


def test_level_cameras_stand_upright():
    assert tilt(cameras(ORBIT)) < 0.01
    assert tilt(cameras(HALF)) < 0.2  # their downward axes alone would lean by 17 degrees
    assert tilt(cameras(FORWARD)) < 1.0
    assert tilt(cameras(ORBIT[:1])) < 30  # one camera: its own down


def test_hands_that_shake_and_a_few_odd_photos_do_not_tip_the_scene():
    rng = np.random.default_rng(0)
    rolls = rng.normal(0, 3, len(ORBIT))
    rolls[::8] = 90.0  # portrait photos whose orientation was lost
    poses = [held(15.0 * i, 25, roll) for i, roll in enumerate(rolls)]
    assert tilt(cameras(poses)) < 1.5


def test_a_video_that_lost_its_rotation_is_set_upright():
    assert tilt(cameras([held(yaw, 25, quarter=1) for yaw in range(0, 360, 15)])) < 0.5
    assert tilt(cameras([held(yaw, 25, quarter=-1) for yaw in range(0, 200, 15)])) < 0.5


def gravity_of(poses) -> np.ndarray:
    return poses[:, :3, 1].copy()


def test_gravity_decides_where_it_is_known():
    # the forward-facing cameras all look 30 degrees down: only gravity knows
    poses = cameras([held(yaw / 10, 30) for yaw in range(-9, 9, 2)])
    assert tilt(poses) > 20
    gravities = gravity_of(poses)
    gravities[::2] = np.nan
    assert tilt(poses, gravities) < 1e-4
    assert find_upright(poses, gravities)[1] == "gravity"


def test_gravity_that_contradicts_itself_is_not_believed():
    poses = cameras(ORBIT)
    wrong = np.random.default_rng(0).normal(size=(len(poses), 3))
    wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
    assert find_upright(poses, wrong)[1] == "the cameras"
    few = gravity_of(poses)
    few[::5] *= -1
    assert find_upright(poses, few)[1] == "gravity"
    assert tilt(poses, few) < 0.01
