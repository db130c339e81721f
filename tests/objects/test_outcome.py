"""Outcomes tell what became of each Gaussian."""

from dataclasses import replace

import pytest
import torch
from small_scenes import globe

from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.change.objects import Placement, grow, insert, place, remove
from gsedit.errors import UsageError
from gsedit.scene.outcome import NEW, Outcome, same


def scene_of(count):
    generator = torch.Generator().manual_seed(0)
    return surface_gaussians(globe(), 60, generator)[:count]


def test_operations_one_after_the_other_are_one():
    scene = scene_of(6)
    dropped = Outcome(scene[1:5], torch.tensor([1, 2, 3, 4]), torch.tensor([0, 1, 0, 0]).bool())
    added = Outcome(
        scene, torch.tensor([0, 1, 3, NEW, NEW, 2]), torch.tensor([0, 0, 0, 1, 1, 1]).bool()
    )
    both = same(scene).then(dropped).then(added)
    assert both.origin.tolist() == [1, 2, 4, NEW, NEW, 3]
    assert both.changed.tolist() == [False, True, False, True, True, True]
    assert both.dropped(6).tolist() == [True, False, False, False, False, True]
    assert not same(scene).dropped(6).any()


@pytest.mark.parametrize(
    "operation",
    [
        lambda scene, inside: remove(scene, inside),
        lambda scene, inside: place(scene, inside, Placement(scale=2.0)),
        lambda scene, inside: insert(scene, scene),
        lambda scene, inside: grow(scene, "snow", 1.0, inside),
    ],
)
def test_values_that_are_not_finite_are_refused_in_one_line(operation):
    scene = scene_of(6)
    means = scene.means.clone()
    means[4, 1] = torch.nan
    with pytest.raises(UsageError, match=r"means of Gaussian 4 are not finite: run"):
        operation(replace(scene, means=means), torch.arange(6) < 3)
