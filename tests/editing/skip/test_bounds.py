"""The bounds of what an edit skips hold: with and without it, results differ by less."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from three_scenes import EXHIBITS, Exhibit

from gsedit.capture.fitting.update import cut, random_patch, share_of_crops
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage
from rasterizer import Camera, Gaussians, Rendering, render


@pytest.fixture(scope="module", params=EXHIBITS)
def exhibit(request) -> Exhibit:
    return EXHIBITS[request.param]()


def cameras(exhibit: Exhibit) -> list[Camera]:
    return [view.camera for view in exhibit.data.views]


def draw(scene: Gaussians, camera: Camera, **more) -> Rendering:
    with torch.no_grad():
        return render(scene, camera, **more)


def masks(exhibit: Exhibit) -> tuple[Region, list[torch.Tensor]]:
    """A region of a part of the scene, and where it shows."""
    text = exhibit.region if exhibit.region != "all" else "sphere:0,-0.5,0,0.35"
    region = Finder(exhibit.scene).select(text)
    return region, [coverage(region, exhibit.scene, each) > 1 / 255 for each in cameras(exhibit)]


def test_crops_of_a_region_are_those_of_all_crops_that_show_it(exhibit):
    _, shown = masks(exhibit)
    views, side, random = exhibit.data.views, 16, torch.Generator().manual_seed(0)
    drawn = [random_patch(views, None, side, random) for _ in range(4000)]
    names = [view.name for view in views]
    useful = [(v.name, b) for v, b in drawn if cut(shown[names.index(v.name)], b).any()]
    share = share_of_crops(shown, side)
    assert 0 < share < 1
    assert len(useful) / len(drawn) == pytest.approx(share, abs=0.03)
    only = [random_patch(views, shown, side, random) for _ in range(2000)]
    for axis in (0, 1):  # where they begin: the same distribution
        wanted, got = (
            torch.tensor([float(box[axis]) for _, box in each]) for each in (useful, only)
        )
        near = 0.06 * views[0].camera.width
        assert float(got.mean()) == pytest.approx(float(wanted.mean()), abs=near)
        assert float(got.std()) == pytest.approx(float(wanted.std()), rel=0.1)


def test_crops_that_are_left_out_hardly_depend_on_the_region(exhibit):
    region, shown = masks(exhibit)
    changed = replace(exhibit.scene, sh=exhibit.scene.sh.clone())
    changed.sh[region.inside, 0] *= -1  # any color turned round
    bound, largest = 1 / 255, 0.0
    for view, mask in zip(exhibit.data.views[:4], shown):
        difference = draw(changed, view.camera).color - draw(exhibit.scene, view.camera).color
        assert difference[~mask].abs().max() <= bound
        largest = max(largest, float(difference.abs().max()))
    assert largest > 10 * bound
