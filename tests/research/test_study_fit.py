"""The study of the fit's recipe runs, on photos that do not decide."""

from __future__ import annotations

from research import study_fit

from gsedit.synthetic import ring_cameras, scenes, traced_dataset


def test_every_arm_is_measured_on_photos_that_no_fit_is_measured_on():
    data = traced_dataset(scenes()[0], ring_cameras(scenes()[0], 12, 24), points=80)
    training, deciding = data.split()
    less = study_fit.development(data, 0.25)
    assert len(less.points) == 20
    assert {v.name for v in less.views} == {v.name for v in training}
    assert not {v.name for v in less.split()[1]} & {v.name for v in deciding}
    arms = {"the recipe": {}, "none": {"dense_start": 0}}
    rows = list(study_fit.study(less, 3, [0], 0.001, arms))
    assert [row["arm"] for row in rows] == ["the recipe", "none"]
    assert all(row["held_out"] > 3 and row["steps"] == 3 for row in rows)
    assert rows[0]["gaussians"] >= rows[1]["gaussians"]
