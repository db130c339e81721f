"""A large scene by groups: they look like it, and what is done to them is done to it."""

from dataclasses import replace

import pytest
import torch
from divide import divide

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.measures.formulas import psnr
from gsedit.scene.merging import coarsen
from rasterizer import render
from rasterizer.numerics import SH_DC


@pytest.fixture(scope="module")
def scenes():
    """A scene, the same divided in twelve, and groups of that."""
    random = torch.Generator().manual_seed(0)
    whole = surface_gaussians(demo_scene(), 1500, random)
    fine = divide(whole, 12, 1, random)
    coarse = coarsen(fine, 2 * len(whole))
    assert coarse is not None
    return whole, fine, coarse


def base(scene):
    return 0.5 + SH_DC * scene.sh[:, 0]


def darkened(coarse, rows=None):
    sh = coarse.scene.sh.clone()
    rows = torch.ones(len(sh), dtype=torch.bool) if rows is None else rows
    sh[rows, 0] = (0.3 * base(coarse.scene)[rows] - 0.5) / SH_DC
    return replace(coarse.scene, sh=sh)


def test_divided_and_coarse_scenes_look_alike(scenes):
    whole, fine, coarse = scenes
    assert 500 < len(coarse.scene) <= 2 * len(whole)
    camera = ring_cameras(demo_scene(), 1, 64)[0]
    one, many, few = (render(s, camera).color.clamp(0, 1) for s in (whole, fine, coarse.scene))
    assert psnr(one, many) > 24
    assert psnr(many, few) > 20


def test_a_group_holds_neighbors(scenes):
    _, fine, coarse = scenes
    assert coarse.group.min() == 0
    assert coarse.group.max() == len(coarse.scene) - 1
    apart = (fine.means - coarse.scene.means[coarse.group]).norm(dim=1)
    extent = (fine.means - fine.means.mean(0)).norm(dim=1)
    assert apart.mean() < 0.1 * extent.mean()
    majority = coarse.majority(fine.means[:, 0] > 0)
    assert (coarse.expand(majority) == (fine.means[:, 0] > 0)).float().mean() > 0.95


def test_what_is_done_to_groups_is_done_to_all(scenes):
    _, fine, coarse = scenes
    edited = coarse.transfer(darkened(coarse))
    camera = ring_cameras(demo_scene(), 1, 64)[0]
    before, after = (render(s, camera).color for s in (fine, edited))
    torch.testing.assert_close(after, 0.3 * before, rtol=0, atol=0.02)
    assert base(edited).min() >= 0
    assert torch.equal(edited.means, fine.means)


def test_what_is_not_changed_stays_as_it_is(scenes):
    _, fine, coarse = scenes
    assert torch.equal(coarse.transfer(coarse.scene).sh, fine.sh)
    some = torch.arange(len(coarse.scene)) < 100
    edited = coarse.transfer(darkened(coarse, some))
    kept = ~coarse.expand(some)
    assert torch.equal(edited.sh[kept], fine.sh[kept])
    assert (edited.sh[~kept] != fine.sh[~kept]).any(-1).any(-1).float().mean() > 0.99


def test_what_no_picture_shows_has_larger_groups(scenes):
    whole, fine, _ = scenes
    near = ring_cameras(demo_scene(), 4, 64)
    means = fine.means.clone()
    away = torch.arange(len(means)) % 2 == 0
    means[away] += torch.tensor([0.0, 0.0, 500.0])  # far above: in none
    apart = replace(fine, means=means)
    one, other = coarsen(apart, 2 * len(whole)), coarsen(apart, 2 * len(whole), near)
    groups = [[int(m.group[rows].unique().numel()) for rows in (away, ~away)] for m in (one, other)]
    assert 0.8 < groups[0][0] / groups[0][1] < 1.25  # alike without cameras
    assert groups[1][1] > 1.3 * groups[0][1]
    assert groups[1][1] > 10 * groups[1][0]
    assert len(other.scene) <= 2 * len(whole)


def test_a_stray_does_not_put_all_others_into_one_group(scenes):
    whole, fine, coarse = scenes
    means = fine.means.clone()
    means[5] = torch.tensor([9e8, -9e8, 0.0])
    strayed = coarsen(replace(fine, means=means), 2 * len(whole))
    assert strayed is not None
    assert len(strayed.scene) > 0.5 * len(coarse.scene)
    assert strayed.scene.means.isfinite().all()
    camera = ring_cameras(demo_scene(), 1, 64)[0]
    one, few = (render(s, camera).color.clamp(0, 1) for s in (fine, strayed.scene))
    assert psnr(one, few) > 24
