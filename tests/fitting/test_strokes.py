"""Strokes of drawn views stay in a scene: where views contradict each other, one of them leads."""

from dataclasses import replace
from math import inf

import pytest
import torch

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.solve import solve_colors
from gsedit.capture.fitting.strokes import (
    LEAST_SHARE,
    leading_views,
    led,
    stroke_steps,
)
from gsedit.measures.features import FilterBank
from gsedit.paper.view_plan import survey
from gsedit.views.dataset import View
from rasterizer.color_weights import color_weights
from rasterizer.render import render
from rasterizer.scene import Gaussians

STEPS = 12


@pytest.fixture(scope="module")
def scene():
    made = surface_gaussians(demo_scene(), 2500, torch.Generator().manual_seed(0))
    return replace(made, sh=made.sh[:, :1].clamp(-1.5, 1.5))


@pytest.fixture(scope="module")
def cameras():
    return ring_cameras(demo_scene(), 8, 48)


@pytest.fixture(scope="module")
def striped(scene, cameras):
    """Views with stripes, which no two views place alike."""
    views = []
    for i, camera in enumerate(cameras):
        picture = render(scene, camera)
        stripes = ((torch.arange(48) + 3 * i) // 4 % 2).float()[:, None, None]
        image = picture.color * (1 - picture.alpha[..., None] * 0.6 * stripes)
        views.append(View(str(i), camera, image))
    return views


def solved(scene, views, weights=None):
    every = torch.ones(len(scene), dtype=torch.bool)
    *_, last = solve_colors(scene, views, every, weights=weights, band_penalty=inf)
    return last.scene


def led_views(scene, cameras):
    leading = leading_views(survey(scene, cameras), scene.means)
    return [led(scene, camera, leading == i) for i, camera in enumerate(cameras)]


def descended(scene, views, inside=None):
    inside = torch.ones(len(scene), dtype=torch.bool) if inside is None else inside
    *losses, last = stroke_steps(
        scene, views, inside, STEPS, FilterBank(), torch.Generator().manual_seed(0),
        weights=[color_weights(scene, view.camera) for view in views],
    )  # fmt: skip
    assert isinstance(last, Gaussians)
    return losses, last


def test_a_view_that_leads_nothing_takes_no_part(scene, cameras, striped):
    every = [color_weights(scene, view.camera) for view in striped]
    for chosen in ([], [1]):  # none, or one, of which the pixels count
        counts = [torch.full((view.camera.height, view.camera.width), 1.0) for view in striped]
        own = [replace(w, wanted=c * (i in chosen)) for i, (w, c) in enumerate(zip(every, counts))]
        *losses, last = stroke_steps(
            scene, striped, torch.ones(len(scene), dtype=torch.bool), 3, FilterBank(),
            torch.Generator().manual_seed(0), weights=own,
        )  # fmt: skip
        assert len(losses) == 3 * len(chosen)
        assert (last.sh != scene.sh).any() == bool(chosen)


def energy(scene, cameras):
    pictures = torch.stack([render(scene, camera).color for camera in cameras])
    return float((pictures[:, 1:] - pictures[:, :-1]).square().mean())


def test_few_views_lead_each_where_it_sees_well_what_none_before_it_does():
    means = torch.randn(81, 3, generator=torch.Generator().manual_seed(0))
    means += 100.0 * torch.arange(3).repeat_interleave(27)[:, None]
    # all that the second sees is seen by the others well enough; the third sees its part alone
    seen = [[4.0, 2.0, 0.0], [0.0, 3.0, 2.0], [0.0, 0.2, 7.0]]
    leading = leading_views(torch.tensor(seen).repeat_interleave(27, 1), means)
    assert leading.reshape(3, 27).tolist() == [[0] * 27, [0] * 27, [2] * 27]
    assert (leading_views(torch.zeros(2, 81), means) == -1).all()


def test_shares_of_views_are_those_of_what_they_lead(scene, cameras):
    shares = torch.stack([each.wanted for each in led_views(scene, cameras)])
    alpha = torch.stack([render(scene, camera).alpha for camera in cameras])
    assert shares[shares > 0].min() >= LEAST_SHARE
    assert (shares <= alpha + 1e-5).all()
    none = torch.zeros(len(scene), dtype=torch.bool)
    assert led(scene, cameras[1], none).wanted.max() == 0


def test_strokes_are_kept_that_a_mean_would_lose(scene, cameras, striped):
    mean = solved(scene, striped)
    first = solved(scene, striped, led_views(scene, cameras))
    _, styled = descended(first, striped)
    between = ring_cameras(demo_scene(), 16, 48)[1::2]
    energies = [energy(each, between) for each in (mean, first, styled)]
    assert energies[0] < energies[1] < energies[2]


def test_only_base_colors_inside_move(scene, striped):
    bands = torch.zeros(len(scene), 4, 3)
    bands[:, 0] = scene.sh[:, 0]
    banded, inside = replace(scene, sh=bands), scene.means[:, 0] > 0
    _, styled = descended(banded, striped, inside)
    same = ~inside
    assert torch.equal(styled.sh[same], banded.sh[same])
    assert torch.equal(styled.sh[:, 1:], banded.sh[:, 1:])
    assert not torch.equal(styled.sh[inside], banded.sh[inside])


def test_a_scene_that_shows_its_targets_stays(scene, cameras):
    targets = [View(str(i), c, render(scene, c).color) for i, c in enumerate(cameras)]
    losses, same = descended(scene, targets)
    assert max(losses) < 1e-9
    assert (same.sh - scene.sh).abs().max() < 1e-3
