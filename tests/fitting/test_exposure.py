"""Photos that differ in exposure are compared after maps of their own; others are left alone."""

from dataclasses import replace

import pytest
import torch
from research.fit import captures
from small_scenes import globe

from gsedit import FitSettings, View, fit
from gsedit.capture.fitting.exposure import Exposures
from rasterizer import look_at

CAMERA = look_at(torch.tensor([0.0, -3.0, 0.0]), torch.zeros(3), torch.tensor([0.0, 0.0, 1.0]),
                 45.0, 24, 24)  # fmt: skip


def photos(spread, count=6):
    """(renders, views of them): one picture, in each view with gains of its own."""
    random = torch.Generator().manual_seed(0)
    picture = 0.1 + 0.5 * torch.rand(24, 24, 3, generator=random)
    gains = (spread * torch.randn(count, 3, generator=random)).exp()
    gains = gains / gains.mean(0)
    return picture, [View(str(i), CAMERA, picture * gain) for i, gain in enumerate(gains)]


def drawn(exposures, picture, views, times):
    for _ in range(times):
        for view in views:
            exposures.compensated(picture, view, view.image)
            exposures.move()


def test_gains_are_found_and_their_mean_is_left_to_the_scene():
    picture, views = photos(0.2)
    exposures = Exposures(views, "on")
    dark = 0.7 * picture  # an unfinished scene, of which the photos are not to blame
    drawn(exposures, dark, views, 8)
    for view in views:
        found = exposures.compensated(dark, view, view.image)
        assert (found - 0.7 * view.image).abs().mean() < 0.2 * (
            0.7 * view.image - dark
        ).abs().mean()
    assert exposures.spread > 0.1


@pytest.mark.parametrize(("spread", "active"), [(0.0, False), (0.02, False), (0.2, True)])
def test_maps_are_used_where_exposures_differ(spread, active):
    picture, views = photos(spread, 12)
    exposures = Exposures(views, "auto")
    drawn(exposures, picture, views, 1)
    assert not exposures.active  # too early to say
    drawn(exposures, picture, views, 3)
    assert exposures.active == active


def test_masked_pixels_say_nothing_about_the_exposure():
    picture, (view, *others) = photos(0.2)
    mask = torch.zeros(24, 24, dtype=torch.bool)
    mask[:12] = True
    spoilt = view.image.clone()
    spoilt[12:] = 0.5
    maps = []
    for one in (view, replace(view, mask=mask, image=spoilt)):
        exposures = Exposures([view, *others], "on")
        exposures.compensated(picture, one, one.image)
        maps.append(exposures.moves[0].clone())
    torch.testing.assert_close(*maps, atol=0.02, rtol=0)
    exposures.compensated(picture, replace(view, mask=~mask & mask), view.image)


GAINS = (1.0, 0.6, 1.4, 0.6, 1.4, 0.6, 1.4, 1.0, 1.0)
"""Exposures of the photos; the first and the last are held out."""


@pytest.fixture(scope="module")
def exposed():
    taken = captures.photographed(captures.room(globe()), len(GAINS), 48, points=200)
    views = tuple(replace(v, image=0.7 * g * v.image) for v, g in zip(taken.views, GAINS))
    return replace(taken, views=views)


def test_a_fit_of_exposed_photos_is_better_with_maps(exposed):
    results = {
        mode: fit(
            exposed,
            FitSettings(steps=150, seconds=None, exposure=mode, coarse=(), densify_every=1000),
            generator=torch.Generator().manual_seed(0),
        ).psnr
        for mode in ("off", "on")
    }
    assert results["on"] > results["off"] + 0.2
