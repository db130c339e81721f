"""An edit with a region: what is outside does not move, and what is measured knows the region."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from math import log10

import numpy as np
import pytest
import torch
from labelled import statue
from regions_iou import iou

import gsedit
from gsedit import Dataset, EditSettings, edit
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.editing.parts import editor_region
from gsedit.errors import UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditProgress, make_editor
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage, lift
from gsedit.views.dataset import capture
from gsedit.views.orbit import circle
from gsedit.views.viewpoints import viewpoints_of
from rasterizer import render

SIZE = 48
QUICK = EditSettings(
    sampler=SamplerSettings(steps=2),
    update=UpdateSettings(patches=1, patch=24),
    views_per_batch=3,
    batches=1,
)


@pytest.fixture(scope="module")
def labelled():
    return statue(1, 1500)


@pytest.fixture(scope="module")
def data(labelled):
    middle = torch.zeros(3, dtype=torch.float64)
    cameras = circle(middle, 0.7, labelled.scene.up, 9, SIZE, elevation=20.0, fov=45.0)
    return Dataset(capture(labelled.gaussians, cameras, [f"view_{i}" for i in range(9)]))


UNREAD = "frobnicated"


@dataclass(frozen=True)
class Painter:
    """Paints red what is shown to it as the subject, and a little of all the rest."""

    subject: torch.Tensor
    scene: gsedit.Gaussians
    data: Dataset
    name: str = "painter"
    cell: int = 8

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities()

    def check(self, prompt):
        return None

    def edit(self, batch, settings, generator):
        images = []
        for original in batch.originals:
            near = min(self.data.views, key=lambda v: float((v.image - original).abs().sum()))
            covered = coverage(Region(self.subject), self.scene, near.camera)[..., None]
            red = torch.tensor([1.0, 0.0, 0.0])
            images.append(torch.lerp(original + 0.01, red, 0.8 * covered).clamp(0, 1))
        yield EditProgress(1, 1, torch.stack(images))


def run(labelled, data, region, editor=None, prompt="as bronze"):
    return edit(
        labelled.gaussians,
        prompt,
        editor=editor or make_editor("closed-form"),
        views=data,
        settings=replace(QUICK, region=region),
        strategy=SinglePass(update_steps=8),
    )


def finder(labelled, data, region="auto"):
    return Finder(labelled.gaussians, viewpoints_of(data), region)


def moved(result, labelled):
    return (result.scene.sh != labelled.gaussians.sh).flatten(1).any(1)


def test_what_is_outside_a_sphere_stays(labelled, data, tmp_path):
    result = run(labelled, data, "sphere:0,0,0,0.2")
    inside = labelled.gaussians.means.norm(dim=1) <= 0.2
    assert torch.equal(result.region.inside, inside)
    assert moved(result, labelled).any()
    assert not moved(result, labelled)[~inside].any()
    for view, original, target in zip(result.originals, result.originals, result.targets):
        free = coverage(result.region, labelled.gaussians, view.camera) < 1e-6
        torch.testing.assert_close(target.image[free], original.image[free])
    gsedit.write_edit(tmp_path / "out", result)
    assert np.array_equal(np.load(tmp_path / "out" / "region.npy"), inside.numpy())
    record = json.loads((tmp_path / "out" / "edit.json").read_text())
    assert record["region"] == {
        "found": "sphere:0,0,0,0.2",
        "expression": "sphere(0.0, 0.0, 0.0, 0.2)",
        "sure": 1.0,
        "gaussians": int(inside.sum()),
    }
    assert record["settings"]["region"] == "sphere:0,0,0,0.2"
    shared = run(labelled, data, str(tmp_path / "out" / "region.npy"))
    assert torch.equal(shared.region.inside, inside)


def test_errors_outside_the_region_are_of_pixels_outside(labelled, data):
    result = run(labelled, data, "box:-1,-1,-0.2,1,1,1")
    squares = []
    for view in data.views[::8]:
        with torch.no_grad():
            after = render(result.scene, view.camera).color.clamp(0, 1)
        outside = coverage(result.region, labelled.gaussians, view.camera) < 0.5
        squares.append((after - view.image).square()[outside])
    expected = -10 * log10(float(torch.cat(squares).mean()))
    assert result.metrics.psnr_outside_region == pytest.approx(expected, abs=0.01)
    assert 0 < result.metrics.rmse_outside_region < result.metrics.rmse_to_unedited


def test_the_ground_truth_is_that_of_the_region(labelled, data):
    """Outside the region, the true edit is the unedited scene: so an edit of a small region begins
    near its ground truth, and that of everything far from it."""
    whole, part = run(labelled, data, "all"), run(labelled, data, "sphere:0,0,0,0.2")
    assert whole.metrics.psnr_outside_region is None
    assert whole.metrics.rmse_outside_region is None
    assert part.metrics.psnr_to_ground_truth > whole.metrics.psnr_to_ground_truth + 3


def test_an_instruction_that_nobody_reads_shows_the_region_by_its_edits(labelled, data):
    editor = Painter(labelled.subject, labelled.gaussians, data)
    result = run(labelled, data, "auto", editor, prompt=UNREAD)
    ones = [torch.ones(SIZE, SIZE)] * 9
    weight = lift(labelled.gaussians, [v.camera for v in data.views], ones).weight
    assert iou(result.region.inside, labelled.subject, weight) > 0.85
    assert not moved(result, labelled)[~result.region.inside].any()
    assert editor_region(finder(labelled, data), editor, UNREAD) is None
    few = Dataset(data.views[::4])
    phrase = finder(labelled, few, "thing('the statue')").subject.inside  # of a region by a phrase
    assert (phrase & labelled.subject).sum() > 0.9 * (phrase | labelled.subject).sum()


def test_empty_and_unknown_regions_are_refused(labelled, data):
    with pytest.raises(UsageError, match=r"holds no Gaussian .* whose centers are from"):
        run(labelled, data, "sphere:50,0,0,1")
    with pytest.raises(UsageError, match="give auto, all"):
        EditSettings(region="the bear")
