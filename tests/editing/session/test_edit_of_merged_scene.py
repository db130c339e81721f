"""An edit of a large scene by its groups is the edit of all of its Gaussians, nearly."""

from dataclasses import replace
from functools import partial

import pytest
import tiny_edits
import torch
from divide import divide

from gsedit import Dataset, edit
from gsedit.editing import grain
from gsedit.editing.measure import pictures_at
from gsedit.measures.formulas import psnr
from gsedit.paper.editors import EditProgress
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.scene.merging import coarsen
from rasterizer import render


@pytest.mark.parametrize(("loss", "decibels"), [("mse+gram", 0.3), ("mse", 2)])
def test_an_edit_by_groups_is_that_of_all_gaussians(monkeypatch, loss, decibels):
    """The solve follows the groups' own weights to the end, few steps do not: it loses more."""
    settings = replace(tiny_edits.SETTINGS, update=replace(tiny_edits.SETTINGS.update, loss=loss))
    scene = divide(tiny_edits.scene(), 4, 1, torch.Generator().manual_seed(0))
    data = tiny_edits.data()
    results = []
    for most in (len(scene), 1500):
        monkeypatch.setattr(grain, "coarsen", partial(coarsen, most=most))
        result = edit(
            scene,
            tiny_edits.PROMPT,
            editor=tiny_edits.Watched(),
            views=data,
            settings=replace(settings, region="box:-9,-9,-9,9,9,0"),
            strategy=SinglePass(20),
        )
        results.append(result)
    whole, merged = results
    assert merged.metrics.rmse_to_unedited > 0.03
    assert abs(merged.metrics.rmse_to_unedited - whole.metrics.rmse_to_unedited) < 0.02
    outside = ~merged.region.inside
    assert outside.any()
    assert torch.equal(merged.scene.sh[outside], scene.sh[outside])
    camera = data.views[4].camera
    one, other, before = (
        render(s, camera).color.clamp(0, 1) for s in (whole.scene, merged.scene, scene)
    )
    assert psnr(one, other) > psnr(one, before) + 6
    assert merged.metrics.psnr_to_ground_truth > whole.metrics.psnr_to_ground_truth - decibels


class Still(tiny_edits.Watched):
    """A 2D editor that changes nothing."""

    def edit(self, batch, settings, generator):
        yield EditProgress(1, 1, batch.originals)


def test_photos_of_all_gaussians_do_not_change_their_groups(monkeypatch):
    generator = torch.Generator().manual_seed(0)
    scene = divide(tiny_edits.scene(), 4, 1, generator)
    noise, views = torch.randn(scene.sh.shape, generator=generator), tiny_edits.data().views
    scene = replace(scene, sh=scene.sh + 0.5 * noise)
    monkeypatch.setattr(grain, "coarsen", partial(coarsen, most=1500))
    usual = tiny_edits.SETTINGS
    sampler, update = replace(usual.sampler, harmonise=False), replace(usual.update, loss="mse")
    settings = replace(usual, sampler=sampler, update=update, condition="photo", region="all")
    given = {"views": Dataset(pictures_at(scene, views)), "settings": settings}
    result = edit(scene, tiny_edits.PROMPT, editor=Still(), **given)
    assert result.metrics.rmse_to_unedited < 0.004  # 0.04 where they do
