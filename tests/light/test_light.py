"""Laws of light: what faces it is lit, what is behind something is not, far things only change
their tone, and nothing outside a region moves."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from changes import painted
from plain_scenes import discs, ring

from gsedit.change.light.relight import relit, survey
from gsedit.change.light.setup import LIGHTS, Fog, Lamp, LightSetup, Sun, setup_of
from gsedit.errors import UsageError
from gsedit.select.region import everything
from gsedit.views.place import light_note, place_of
from gsedit.words.instruction import Change
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.scene import Gaussians, concatenate

CAMERAS = ring()
DARK = (0.02, 0.02, 0.02)


def ball(count: int = 1500, radius: float = 0.5, center=(0.0, 0.0, 0.5)) -> Gaussians:
    """A gray ball of small discs, on a gray floor at height 0."""
    draw = torch.Generator().manual_seed(0)
    unit = torch.nn.functional.normalize(torch.randn(count, 3, generator=draw), dim=-1)
    side = torch.arange(-1.5, 1.5, 0.07)
    x, y = torch.meshgrid(side, side, indexing="ij")
    floor = torch.stack((x.flatten(), y.flatten(), torch.zeros(x.numel())), -1)
    means = torch.cat((radius * unit + torch.tensor(center), floor))
    normals = torch.cat((unit, torch.tensor((0.0, 0.0, 1.0)).expand(len(floor), 3)))
    scene = discs(means, normals)
    return replace(scene, sh=torch.cat((scene.sh, torch.full((len(means), 3, 3), 0.05)), 1))


def shown(scene: Gaussians) -> torch.Tensor:
    """Luminance of the colors of Gaussians."""
    return sh_to_color(scene.sh[:, 0]).mean(-1)


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return ball()


def test_what_faces_the_sun_is_brighter_and_its_shadow_is_dark(scene):
    sun = LightSetup(DARK, DARK, Sun(-90.0, 30.0, 1.0))
    after = shown(relit(scene, sun, CAMERAS))
    x, y, z = scene.means.unbind(-1)
    assert after[x < -0.4].mean() > 2 * after[(x > 0.4) & (z > 0.2)].mean()
    floor = (z == 0) & (y.abs() < 0.2)
    behind, before = floor & (x > 0.6) & (x < 1.1), floor & (x < -0.7) & (x > -1.2)
    assert after[behind].mean() < 0.6 * after[before].mean()


def test_the_side_of_the_sun_is_told_from_the_cameras(scene):
    x = scene.means[:, 0]
    for words, sign in (("sunset from the left", -1), ("sunset from the right", 1)):
        after = shown(relit(scene, setup_of(words), CAMERAS))
        assert after[sign * x > 0.4].mean() > 1.2 * after[sign * x < -0.4].mean()


def test_an_open_sky_darkens_what_is_under_the_ball_least_light_from_above_most(scene):
    lamp = LightSetup(DARK, DARK, lamps=(Lamp(0.0, 89.0, 1.0),))
    after = shown(relit(scene, lamp, CAMERAS))
    x, y, z = scene.means.unbind(-1)
    top, under = z > 0.9, (z < 0.3) & (z > 0)
    assert after[top].mean() > 2 * after[under].mean()
    floor = z == 0
    near, open_ = floor & (x.hypot(y) < 0.25), floor & (x.hypot(y) > 0.7) & (x.hypot(y) < 1.0)
    assert after[near].mean() < after[open_].mean()


def surrounded(scene: Gaussians) -> Gaussians:
    """The scene, with another one like it far away."""
    far = replace(scene, means=scene.means + torch.tensor((0.0, 40.0, 0.0)))
    return concatenate(scene, far)


def test_light_is_linear_in_its_strength_unless_it_is_dim(scene):
    bright = replace(scene, sh=color_to_sh(torch.full((len(scene), 1, 3), 0.6)))
    both = surrounded(bright)
    once, double = (relit(both, LightSetup(3 * (s,), 3 * (s,)), CAMERAS) for s in (0.5, 1.0))
    ratio = sh_to_color(double.sh[:, 0]) / sh_to_color(once.sh[:, 0])
    torch.testing.assert_close(ratio, torch.full_like(ratio, 2 ** (1 / 2.2)), rtol=1e-3, atol=1e-3)
    bands = double.sh[:, 1:] / once.sh[:, 1:]
    torch.testing.assert_close(bands, torch.full_like(bands, 2 ** (1 / 2.2)), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("albedo", [0.02, 0.5])
def test_an_object_that_is_alone_is_seen_at_night_and_more_light_is_brighter(scene, albedo):
    color = color_to_sh(torch.full((len(scene), 1, 3), albedo))
    lone = replace(scene, sh=color)
    nights = [shown(relit(lone, setup_of("night", amount), CAMERAS)) for amount in (0.0, 0.5)]
    night, deeper = (float(each.mean()) for each in nights)
    assert night > 0.1
    assert deeper < night
    assert "nothing is around" in str(light_note(lone, place_of(lone, CAMERAS), None))
    assert not place_of(surrounded(lone), CAMERAS).alone
    around = relit(surrounded(lone), setup_of("night"), CAMERAS)[: len(lone)]
    assert shown(around).mean() < night


def test_the_night_of_a_dark_capture_is_seen_and_no_brighter_than_its_day(scene):
    dark = surrounded(replace(scene, sh=color_to_sh(torch.full((len(scene), 1, 3), 0.2))))
    night = shown(relit(dark, setup_of("moonlight"), CAMERAS))[: len(scene)]
    assert 0.15 < night.mean() < 0.2


def test_what_is_far_changes_its_tone_only(scene):
    both, cameras = surrounded(scene), CAMERAS
    after = relit(both, LIGHTS["sunny"], cameras)
    color = sh_to_color(after.sh[len(scene) :, 0])
    torch.testing.assert_close(color, color[:1].expand_as(color), rtol=0, atol=1e-5)
    note = light_note(both, place_of(both, cameras), torch.ones(len(both)))
    assert note is not None
    assert "50%" in note


def test_fog_hides_the_far_more_than_the_near(scene):
    fog = LightSetup((1.0, 1.0, 1.0), DARK, fog=Fog((1.0, 1.0, 1.0), 2.0, start=0.0, base=0.0))
    clear = replace(fog, fog=None)
    gain = shown(relit(scene, fog, CAMERAS)) - shown(relit(scene, clear, CAMERAS))
    away = (scene.means - place_of(scene, CAMERAS).center).norm(dim=-1)
    order = away.argsort()
    assert gain[order[-200:]].mean() > gain[order[:200]].mean() + 0.1


def test_outside_a_region_no_bit_changes(scene):
    inside = scene.means[:, 2] > 0.5
    change = Change("subject", "light", "night", None, None, "light")
    after = painted(scene, change, inside, CAMERAS).scene
    assert torch.equal(after.sh[~inside], scene.sh[~inside])
    assert not torch.equal(after.sh[inside], scene.sh[inside])
    assert torch.equal(after.means, scene.means)


@pytest.mark.parametrize(("name", "amount"), [("night", 5.0), ("night", -2.0), ("shine", None)])
def test_a_light_out_of_range_or_unknown_is_refused(scene, name, amount):
    change = Change("scene", "light", name, None, amount, "light")
    with pytest.raises(UsageError, match=r"out of range|there is no light"):
        painted(scene, change, everything(scene).inside, CAMERAS)


def test_more_of_a_night_is_darker_and_of_a_lamp_brighter(scene):
    for name, sign in (("night", -1), ("lamp", 1), ("sunset", 1)):
        change = Change("scene", "light", name, None, None, "light")
        more = replace(change, amount=0.5)
        whole = everything(scene)
        one, two = (painted(scene, c, whole.inside, CAMERAS).scene for c in (change, more))
        assert sign * (shown(two).mean() - shown(one).mean()) > 0.005


def test_a_ground_throws_back_no_more_than_half_of_what_it_gets(scene):
    pale_below = scene.means[:, 2:] < torch.where(scene.means[:, 2:] > 0, 0.3, -1.0)
    colors = torch.where(pale_below, 0.9, 0.15).expand(-1, 3)
    found = survey(replace(scene, sh=color_to_sh(colors[:, None].clone())), CAMERAS)
    assert float(found.weights[-1]) <= 0.5


def test_relighting_a_ball_is_nearer_to_the_truth_than_any_tone():
    """Exact colors of a ball whose sun moves, against the best gain of every channel."""
    few, cameras = ball(2500)[:2500], CAMERAS
    normals = torch.nn.functional.normalize(few.means - torch.tensor((0.0, 0.0, 0.5)), dim=-1)
    paint = 0.3 + 0.4 * (6 * few.means).sin().square()

    def exact(sun: Sun | None, sky: float) -> torch.Tensor:
        """Display colors: a convex solid hides only what is behind it."""
        light = sky * (1 + normals[:, 2]) / 2
        if sun is not None:
            toward = place_of(few, cameras).direction(sun.azimuth, sun.elevation).float()
            light = light + sun.strength * (normals @ toward).clamp_min(0)
        return paint * light[:, None].clamp_min(0.02) ** (1 / 2.2)

    first, second = Sun(60.0, 50.0, 0.5), Sun(-70.0, 35.0, 1.0)
    old, truth = exact(first, 0.6), exact(second, 0.3)
    before = replace(few, sh=color_to_sh(old)[:, None])
    new = sh_to_color(relit(before, LightSetup((0.3,) * 3, DARK, second), cameras).sh[:, 0])
    tone = old * (old * truth).sum(0) / (old * old).sum(0)
    top = normals[:, 2] > 0  # what the cameras see
    assert (new - truth)[top].square().mean() < 0.5 * (tone - truth)[top].square().mean()
