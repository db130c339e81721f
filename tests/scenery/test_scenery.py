"""Laws of weather and seasons: snow lies on what faces up, autumn turns leaves alone, wet ground is
darker and mirrors the sky, and nothing outside a region moves."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from changes import painted
from plain_scenes import cloud, discs, ring

from gsedit.change.light.relight import survey
from gsedit.change.scenery.effects import SCENERIES, Setting, autumn, in_scenery, snow
from gsedit.errors import UsageError
from gsedit.words.instruction import Change
from rasterizer.harmonics import colors
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.scene import Gaussians, concatenate

CAMERAS = ring(6, 1.5, 0.2)
GREEN, STONE = (0.25, 0.5, 0.15), (0.55, 0.54, 0.52)


def box_scene(color=STONE) -> Gaussians:
    """A block of stone on a floor: level discs on top and around, upright ones on two sides."""
    side = torch.arange(-1.2, 1.21, 0.06)
    x, y = (each.flatten() for each in torch.meshgrid(side, side, indexing="ij"))
    top = (x.abs() < 0.4) & (y.abs() < 0.4)
    level = torch.stack((x, y, torch.where(top, 0.5, 0.0)), -1)
    across, height = (
        each.flatten()
        for each in torch.meshgrid(
            torch.arange(-0.36, 0.37, 0.06), torch.arange(0.05, 0.5, 0.06), indexing="ij"
        )
    )
    walls = [torch.stack((across, torch.full_like(across, at), height), -1) for at in (-0.4, 0.4)]
    means = torch.cat((level, *walls))
    up, aside = torch.eye(3)[[2, 1]]
    normals = torch.cat((up.expand(len(level), 3), -aside.expand(len(means) - len(level), 3)))
    scene = discs(means, normals)
    return replace(scene, sh=color_to_sh(torch.tensor(color)).expand(len(means), 1, 3).clone())


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return box_scene()


@pytest.fixture(scope="module")
def setting(scene) -> Setting:
    return Setting(scene, survey(scene, CAMERAS), CAMERAS)


def test_snow_whitens_what_faces_up_and_leaves_the_walls(scene, setting):
    cover = snow(setting).veil
    wall = scene.means[:, 1].abs() == 0.4
    wall &= (scene.means[:, 2] > 0.1) & (scene.means[:, 2] < 0.4)
    assert cover[scene.means[:, 2] == 0.5].mean() > 0.8
    assert cover[wall].mean() < 0.25


def test_autumn_turns_bushes_to_many_colors_lawns_to_straw_and_not_stone(scene, setting):
    leaves = scene.means[:, 0] > 0.5
    colors = torch.where(leaves[:, None], torch.tensor(GREEN), torch.tensor(STONE))
    garden = replace(scene, sh=color_to_sh(colors)[:, None])
    loose = replace(setting.found.surface, confidence=torch.full((len(scene),), 0.5).double())
    inner, stone, shown = scene.means[:, 0] > 0.7, scene.means[:, 0] < 0.2, []
    for found in (setting.found, replace(setting.found, surface=loose)):
        after = sh_to_color(autumn(Setting(garden, found, CAMERAS)).applied(garden).sh[:, 0])
        torch.testing.assert_close(after[stone], colors[stone], rtol=0, atol=1e-5)
        shown.append(after[inner, 1] / after[inner, 0])
    lawn, bush = shown
    assert 0.7 < float(lawn.median()) < 0.95
    assert float(bush.std()) > 2 * float(lawn.std())
    assert float((bush < 0.7).double().mean()) > 0.3


def test_a_pale_green_stain_on_smooth_stone_is_no_foliage(scene, setting):
    stained = replace(
        scene, sh=color_to_sh(torch.tensor((0.5, 0.53, 0.4))).expand(len(scene), 1, 3)
    )
    found = setting.found
    smooth = Setting(stained, found, CAMERAS)
    leafy = replace(found.surface, confidence=torch.full((len(scene),), 0.6).double())
    rough = Setting(stained, replace(found, surface=leafy), CAMERAS)
    sides = found.surface.confidence > 0.97
    assert rough.foliage[sides].mean() > 0.5
    assert smooth.foliage[sides].mean() < 0.1


def test_snow_is_as_bright_in_a_dark_capture_as_in_a_bright_one(scene):
    top = (scene.means[:, 2] == 0.5) & (scene.means[:, :2].abs().amax(1) < 0.3)
    whites = []
    for stone in ((0.2, 0.2, 0.19), (0.7, 0.69, 0.66)):
        after = in_scenery(box_scene(stone), "snow", CAMERAS)
        whites.append(float(sh_to_color(after.sh[top, 0]).mean()))
    assert min(whites) > 0.8
    assert abs(whites[0] - whites[1]) < 0.08


def test_wet_ground_is_darker_and_mirrors_the_sky_at_a_low_angle(scene):
    far = torch.randn(600, 3, generator=torch.Generator().manual_seed(0))
    dome = cloud(6 * torch.nn.functional.normalize(far, dim=-1), -0.5, 1.0)  # bright
    both = concatenate(scene, dome)
    after = in_scenery(both, "wet", CAMERAS)
    floor = (scene.means[:, 2] == 0) & (scene.means.norm(dim=-1) < 1.0)
    rows = floor.nonzero().squeeze(-1)
    assert after.degree == 2
    steep = colors(after.sh[rows], torch.tensor((0.0, 0.3, -1.0)).expand(len(rows), 3))
    low = colors(after.sh[rows], torch.tensor((0.0, 1.0, -0.12)).expand(len(rows), 3))
    assert steep.mean() < 0.9 * sh_to_color(scene.sh[rows, 0]).mean()
    assert low.mean() > steep.mean() + 0.02


@pytest.mark.parametrize("name", sorted(SCENERIES))
def test_outside_a_region_no_coefficient_changes(scene, name):
    inside = scene.means[:, 0] > 0
    change = Change("subject", "look", name, None, None, "scenery")
    after = painted(scene, change, inside, CAMERAS).scene
    assert after.sh.isfinite().all()
    assert torch.equal(after.sh[~inside, :1], scene.sh[~inside])
    assert not after.sh[~inside, 1:].any()


def test_an_unknown_scenery_is_refused(scene):
    with pytest.raises(UsageError, match="there is no scenery"):
        in_scenery(scene, "hail", CAMERAS)
