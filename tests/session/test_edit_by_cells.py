"""An edit of a large scene by its cells is the edit of all of its Gaussians, nearly."""

from __future__ import annotations

from dataclasses import replace

import tiny_edits
import torch

from gsedit.bench.scale.divide import divide
from gsedit.edit import edit
from gsedit.measures.metrics import psnr
from gsedit.strategies.single_pass import SinglePass
from gsedit.views import coarse
from rasterizer.render import render


def test_an_edit_by_cells_is_that_of_all_gaussians(monkeypatch):
    scene = divide(tiny_edits.scene(), 4, 1, torch.Generator().manual_seed(0))
    data = tiny_edits.data()
    results = []
    for most in (len(scene), 1500):
        monkeypatch.setattr(coarse, "MOST", most)
        result = edit(
            scene,
            tiny_edits.PROMPT,
            editor=tiny_edits.Watched(),
            dataset=data,
            settings=replace(tiny_edits.SETTINGS, region="box:-9,-9,-9,9,9,0"),
            strategy=SinglePass(20),
        )
        results.append(result)
    whole, cells = results
    assert cells.quality.strength > 0.03
    assert abs(cells.quality.strength - whole.quality.strength) < 0.02
    outside = ~cells.region.inside
    assert outside.any()
    assert torch.equal(cells.scene.sh[outside], scene.sh[outside])
    camera = data.views[4].camera
    one, other, before = (
        render(s, camera).color.clamp(0, 1) for s in (whole.scene, cells.scene, scene)
    )
    assert psnr(one, other) > psnr(one, before) + 6
    assert cells.quality.psnr_to_ground_truth > whole.quality.psnr_to_ground_truth - 0.3
