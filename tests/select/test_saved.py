"""Selections with names: however spelt, of one scene, carried by an edit."""

import numpy as np
import pytest

from gsedit.errors import InputError
from gsedit.select.saved import (
    carry_named,
    key_of_name,
    read_named,
    save_named,
    saved_file,
    saved_names,
)

MEANS = np.random.default_rng(0).normal(size=(6, 3)).astype(np.float32)
FLAGS = np.array([True, False, True, True, False, False])


@pytest.mark.parametrize("name", ["chair", "The Chair", "my chair", "the  CHAIR"])
def test_a_name_is_found_however_it_is_said(tmp_path, name):
    made = save_named(FLAGS, MEANS, tmp_path / "a.ply", "The Chair")
    assert saved_file(tmp_path / "a.ply", name) == made
    assert key_of_name("left_leg-2") == key_of_name("the Left leg 2") == "left leg 2"


def test_a_selection_is_of_the_rows_that_it_was_made_on(tmp_path):
    file = save_named(FLAGS, MEANS, tmp_path / "a.ply", "chair")
    assert (read_named(file, MEANS) == FLAGS).all()
    assert (np.load(file) == FLAGS).all()
    for others in (MEANS[::-1], MEANS + np.float32(0.1), MEANS[:4]):
        with pytest.raises(InputError) as error:
            read_named(file, np.ascontiguousarray(others))
        assert "chair.npy" in str(error.value)
        assert "\n" not in str(error.value)


def test_flags_follow_their_rows_and_stale_ones_are_left_behind(tmp_path):
    before, after = tmp_path / "a.ply", tmp_path / "out" / "scene.ply"
    save_named(FLAGS, MEANS, before, "chair")
    save_named(FLAGS, MEANS + 1, before, "stale")
    save_named(FLAGS, MEANS, after, "of an earlier edit")
    origin = np.array([5, 3, -1, 0])
    made = np.ones((4, 3), np.float32)
    carry_named(before, MEANS, after, made, origin)
    assert saved_names(after) == ("chair",)
    file = saved_file(after, "chair")
    assert file is not None
    assert read_named(file, made).tolist() == [False, True, False, True]
    carry_named(before, MEANS, after, MEANS, None)
    assert (read_named(file, MEANS) == FLAGS).all()
    assert saved_names(before) == ("chair", "stale")
