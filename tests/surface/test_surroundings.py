"""Surroundings of a subject against skies that are known."""

from __future__ import annotations

import pytest
import torch
from closeness import EPS32, assert_near
from plain_scenes import cloud

from gsedit.scene.color_space import linear_of_srgb
from gsedit.scene.quaternions import even_directions
from gsedit.views import surroundings as light
from gsedit.views.surroundings import cell_areas, cell_directions, look_up
from rasterizer.scene import Gaussians, concatenate

SKY = 3000
CENTER = torch.tensor((0.3, -0.2, 0.1))


def sky_color(directions):
    """Display colors: blue above, brown below, brighter to +x; none is clipped."""
    x, _, z = directions.unbind(-1)
    return torch.stack((0.4 + 0.2 * x - 0.1 * z, 0.4 + 0.1 * x, 0.45 + 0.3 * z), -1)


def dome(where=None) -> Gaussians:
    """Discs on a sphere of radius 20 around CENTER, colored by direction."""
    directions = torch.from_numpy(even_directions(SKY)).float()
    if where is not None:
        directions = directions[where(directions)]
    return cloud(CENTER + 20 * directions, 0.0, sky_color(directions), 5.0)


def with_subject(sky):
    """A small cloud of Gaussians in the middle of a sky, and which they are."""
    points = torch.from_numpy(even_directions(50)).float()
    own = cloud(CENTER + 0.5 * points, -2.0)
    subject = torch.zeros(len(sky) + 50, dtype=torch.bool)
    subject[-50:] = True
    return concatenate(sky, own), subject


@pytest.fixture(scope="module")
def found():
    return light.find_surroundings(*with_subject(dome()))


def test_a_known_sky_is_found_around_the_subject(found):
    assert not found.studio
    display = sky_color(cell_directions(light.ROWS))
    exact = torch.from_numpy(linear_of_srgb(display.numpy()))
    torch.testing.assert_close(found.radiance, exact, atol=0.02, rtol=0.05)
    assert float((found.distance - 20).abs().median()) < 1
    assert torch.allclose(found.center, CENTER, atol=0.05)


def test_what_no_camera_saw_is_filled_smoothly():
    half = light.find_surroundings(*with_subject(dome(lambda d: d[:, 2] < 0.3)))
    zenith, rim = half.radiance[0].mean(0), half.radiance[28].mean(0)
    assert float(half.seen[0].max()) < 0.01
    assert bool((zenith > 0.5 * rim).all())
    assert bool((zenith < 2 * rim).all())
    steps = (half.radiance[1:20] - half.radiance[:19]).abs()
    assert float(steps.max()) < 0.05


def test_an_object_alone_gets_a_studio(found):
    scene, subject = with_subject(dome())
    alone = light.find_surroundings(scene[subject], torch.ones(50, dtype=torch.bool))
    assert alone.studio
    assert float(alone.radiance.max()) > 1
    up = torch.tensor((0.0, 0.0, 1.0))
    made = light.studio(torch.zeros(3), up)
    over = cell_directions(len(made.radiance)) @ up > 0
    assert float(made.radiance[over].mean()) > 2 * float(made.radiance[~over].mean())


def test_filters_keep_a_constant_light():
    even = light.Surroundings(
        CENTER, torch.full((64, 128, 3), 0.4), torch.full((64, 128), 9.0), torch.ones(64, 128)
    )
    # means of 8192 cells: a random walk of their roundings is 90 long
    assert_near(light.prefiltered(even), torch.full((7, 64, 128, 3), 0.4), 900 * EPS32)


def test_rougher_reflections_vary_less(found):
    maps = light.prefiltered(found)
    spread = maps.flatten(1, 2).std(1).mean(-1)
    assert bool((spread[1:] <= spread[:-1] + 1e-4).all())
    mirror = torch.from_numpy(even_directions(40)).float()
    sharp = light.reflected(maps, mirror, torch.zeros(40))
    torch.testing.assert_close(sharp, look_up(found.radiance, mirror))


def test_balance_takes_the_mean_color_and_keeps_the_luminance(found):
    whole = light.balanced(found, 1.0)
    areas = cell_areas(64)[..., None]
    before, after = ((each.radiance * areas).sum((0, 1)) for each in (found, whole))
    assert float(after.std()) < 1e-3 * float(after.mean())
    weights = torch.tensor(light.LUMINANCE, dtype=after.dtype)
    torch.testing.assert_close(after @ weights, before @ weights)
