"""The bounds of what an edit skips hold: with and without it, results differ by less."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
import torch
from three_scenes import EXHIBITS, Exhibit

from gsedit.capture.fitting.update import cut, random_patch, share_of_crops
from gsedit.paper.consistency.correspond import correspond
from gsedit.paper.draw import INVISIBLE_COLOR, band_colors, visible_coefficients
from gsedit.paper.edit_views import MIN_MATCH_OVERLAP
from gsedit.paper.view_plan import survey, view_overlap
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage
from gsedit.views.depth_maps import DEFAULT_RULES
from rasterizer import Camera, Gaussians, Rendering, render
from rasterizer.harmonics import basis


@pytest.fixture(scope="module", params=EXHIBITS)
def exhibit(request) -> Exhibit:
    return EXHIBITS[request.param]()


def cameras(exhibit: Exhibit) -> list[Camera]:
    return [view.camera for view in exhibit.data.views]


def draw(scene: Gaussians, camera: Camera, **more) -> Rendering:
    with torch.no_grad():
        return render(scene, camera, **more)


def test_a_band_adds_no_more_than_its_bound_in_any_direction():
    random = torch.Generator().manual_seed(0)
    sh = torch.randn(40, 16, 3, generator=random, dtype=torch.float64)
    directions = torch.randn(300, 3, generator=random, dtype=torch.float64)
    values = basis(torch.nn.functional.normalize(directions, dim=-1), 3)
    most = band_colors(sh)
    for degree in (1, 2, 3):
        rows = slice(degree**2, (degree + 1) ** 2)
        added = torch.einsum("dk,nkc->ndc", values[:, rows], sh[:, rows]).abs().amax((1, 2))
        assert (added <= most[:, degree - 1]).all()
        assert (added > 0.5 * most[:, degree - 1]).any()


def test_bands_that_add_less_than_half_a_step_are_not_drawn(exhibit):
    small = torch.Generator().manual_seed(1)
    scene = exhibit.scene
    sh = torch.cat((scene.sh, scene.sh.new_zeros(len(scene), 16 - scene.sh.shape[1], 3)), 1)
    sh[:, 9:] += 4e-4 * torch.randn(len(scene), 7, 3, generator=small)
    kept = visible_coefficients(sh)
    assert kept <= 9
    camera = exhibit.data.views[0].camera
    whole, less = (draw(replace(scene, sh=each), camera).color for each in (sh, sh[:, :kept]))
    assert (whole - less).abs().max() <= INVISIBLE_COLOR
    sh[0, 15] = 1.0  # one Gaussian that shows it needs the band
    assert visible_coefficients(sh) == 16


def test_pairs_that_hardly_overlap_match_hardly_any_cells(exhibit):
    views = cameras(exhibit)
    weights = survey(exhibit.scene, views)
    overlap = view_overlap(weights, weights)
    drawn = [draw(exhibit.scene, camera, median_depth=True) for camera in views]
    depths = torch.stack([each.median_depth for each in drawn])
    alphas = torch.stack([each.alpha for each in drawn])
    matched = correspond(views, depths, alphas).matched
    pairs = itertools.combinations(range(len(views)), 2)
    apart = {(a, b) for a, b in pairs if overlap[a, b] < MIN_MATCH_OVERLAP}
    bound = MIN_MATCH_OVERLAP * DEFAULT_RULES.footprint**2 / DEFAULT_RULES.min_alpha
    assert all(matched[pair] <= bound for pair in apart)
    fewer = correspond(views, depths, alphas, apart=apart).matched
    assert (fewer - matched).abs().max() <= (bound if apart else 0)
    assert all(fewer[pair] == 0 for pair in apart)


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
