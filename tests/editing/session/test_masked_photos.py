"""An edit that is shown photos is not shown what their masks hide."""

from __future__ import annotations

from dataclasses import replace

import torch
from tiny_edits import PROMPT, SETTINGS, data, scene

import gsedit
from gsedit import Dataset
from gsedit.paper.editors import make_editor
from gsedit.paper.strategies.single_pass import SinglePass


def masked() -> Dataset:
    """Photos of which the upper half is hidden, and noise."""
    draw = torch.Generator().manual_seed(0)
    views = []
    for view in data().views:
        mask = torch.ones(view.image.shape[:2], dtype=torch.bool)
        mask[: len(mask) // 2] = False
        noise = torch.rand(view.image.shape, generator=draw)
        image = torch.where(mask[..., None], view.image, noise)
        views.append(replace(view, image=image, mask=mask))
    return Dataset(tuple(views))


def test_the_render_is_edited_where_the_photo_is_masked():
    sampler = replace(SETTINGS.sampler, precision="float32")  # fewer bits make much of rounding
    settings = replace(SETTINGS, condition="photo", batches=1, sampler=sampler, region="all")
    strategy, results = SinglePass(1), []
    how = {"settings": settings, "strategy": strategy}
    for dataset in (masked(), data()):
        editor = make_editor("closed-form")
        results.append(gsedit.edit(scene(), PROMPT, views=dataset, editor=editor, **how))
    for a, b in zip(results[0].targets, results[1].targets, strict=True):
        assert a.mask is None  # the edited picture is whole
        torch.testing.assert_close(a.image, b.image, atol=1e-4, rtol=0)  # photos were renders
