"""The tone route: exact in pictures, signed, continuous, and nothing outside changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from changes import painted

from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.editing.painters import TONES, tone_map
from gsedit.errors import UsageError
from gsedit.scene.color_space import LUMINANCE
from gsedit.select.region import everything
from gsedit.words.instruction import Change
from rasterizer.render import render


@pytest.fixture(scope="module")
def scene():
    found = surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))
    return replace(found, sh=found.sh / 2)  # no color becomes negative: those are drawn as 0


def tone(name: str, amount: float | None = None, color: str | None = None) -> Change:
    return Change("scene", "tone", name, color, amount, "tone")


def picture(scene):
    return render(scene, ring_cameras(demo_scene(), 3, 48)[0])


@pytest.mark.parametrize("name", TONES)
def test_a_tone_of_the_scene_is_the_map_of_its_pictures(scene, name):
    before = picture(scene)
    after = picture(painted(scene, tone(name, 0.2), everything(scene).inside).scene).color
    chart = tone_map(name, 0.2)
    alpha = before.alpha[..., None].double().numpy()
    expected = before.color.double().numpy() @ chart.matrix.T + alpha * chart.offset
    assert np.abs(after.numpy() - expected).max() < 2e-3


@pytest.mark.parametrize("name", ["brightness", "contrast", "saturation", "warmth"])
def test_the_sign_is_done(name):
    colors = np.array([[0.8, 0.5, 0.3], [0.2, 0.3, 0.6]])

    def measure(amount: float) -> float:
        after = tone_map(name, amount)(colors)
        return {
            "brightness": after.mean(),
            "contrast": np.ptp(after @ LUMINANCE),
            "saturation": np.ptp(after, axis=1).mean(),
            "warmth": (after[:, 0] - after[:, 2]).mean(),
        }[name]

    values = [measure(amount) for amount in (-0.9, -0.3, -0.01, 0.0, 0.01, 0.3, 0.9)]
    assert values == sorted(values)
    assert tone_map(name, 0.0)(colors) == pytest.approx(colors)


def test_a_tint_keeps_the_luma_and_takes_the_color():
    after = tone_map("hue", 1.0, "#0000ff")(np.full((1, 3), 0.05))[0]
    assert after @ LUMINANCE == pytest.approx(0.05 * LUMINANCE.sum())
    assert after[2] > 10 * after[0]


def test_grayscale_has_no_color_from_any_direction(scene):
    sh = painted(scene, tone("grayscale"), everything(scene).inside).scene.sh
    assert (sh - sh.mean(-1, keepdim=True)).abs().max() < 1e-6


def test_outside_the_region_the_bits_are_the_same(scene):
    inside = scene.means[:, 0] > 0
    after = painted(scene, tone("negative"), inside).scene
    assert torch.equal(after.sh[~inside], scene.sh[~inside])
    assert not torch.equal(after.sh[inside], scene.sh[inside])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (tone("brightness", -1.5), "-100%"),
        (tone("sepia", -0.2), "+0%"),
        (tone("contrast", float("nan")), "out of range"),
        (tone("sparkle", 0.1), "choose one of brightness"),
        (tone("hue", 0.3, "blueish"), "#008080"),
    ],
)
def test_a_tone_that_cannot_be_done_is_refused(scene, change, said):
    with pytest.raises(UsageError, match=said.replace("+", r"\+")):
        painted(scene, change, everything(scene).inside)
