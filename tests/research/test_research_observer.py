"""An observer of an edit measures by the same pictures, whether it made them or was given them."""

from __future__ import annotations

import torch
from research.paper.observe import OWN, Observed, Observer
from three_scenes import Swapped

from gsedit import Dataset, EditSettings, edit_steps
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.paper.protocol import Capabilities
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.dataset import capture


class Unknown(Swapped):
    """An editor that knows no true edit."""

    capabilities = Capabilities()


def observed(own=None):
    scene = surface_gaussians(demo_scene(), 300, torch.Generator().manual_seed(0))
    views = capture(scene, ring_cameras(demo_scene(), 9, 32), [str(i) for i in range(9)])
    observer = Observer(own=own)
    for _ in edit_steps(
        scene, "as bronze", views=Dataset(views), editor=Unknown(),
        settings=EditSettings(batches=1, region="all", held_out_edits=0),
        strategy=Observed(SinglePass(update_steps=1), observer),
        generator=torch.Generator().manual_seed(0),
    ):  # fmt: skip
        pass
    return observer


def test_own_pictures_that_are_given_are_those_that_were_made():
    first = observed()
    second = observed(first.own)
    assert first.kind == second.kind == OWN
    assert torch.equal(first.truths, second.truths)
    assert first.own is not None
    assert not torch.equal(first.own, first.truths)  # where nothing is shown nothing can follow
