"""The weights that come with gsedit: their model card is true, and they edit as they should."""

import json
import re

import pytest
import torch
from safetensors import safe_open

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch, make_editor
from gsedit.editors.small.denoiser import DEFAULTS, load_small
from gsedit.editors.small.shipped import WEIGHTS
from gsedit.synthetic import demo_scene, ring_cameras
from gsedit.words.looks import LOOKS

CARD = WEIGHTS.with_name("MODEL_CARD.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def small():
    return load_small()


def test_they_fit_in_the_package():
    assert WEIGHTS.stat().st_size <= 16e6
    with safe_open(WEIGHTS, framework="pt") as file:
        assert {str(file.get_tensor(name).dtype) for name in file.keys()} == {"torch.float16"}  # noqa: SIM118


def test_they_know_the_looks_that_sentences_are_read_as(small):
    with safe_open(WEIGHTS, framework="pt") as file:
        assert json.loads(file.metadata()["looks"]) == list(small.looks)
    assert set(small.looks) == set(LOOKS)
    understand = make_editor("small").capabilities.understand
    assert understand is not None
    assert understand("cast it in bronze").names == ("bronze",)


def test_the_card_states_how_they_were_made(small):
    weights = sum(value.numel() for value in small.network.state_dict().values())
    assert f"{weights / 1e6:.1f} M weights" in CARD
    assert f"{WEIGHTS.stat().st_size / 1e6:.1f} MB" in CARD
    s_T, s_I, temperature, *_ = DEFAULTS
    assert f"s_T {s_T:g}, s_I {s_I:g}, starting noise of {temperature:g}" in CARD
    steps = re.findall(r"([\d,]+) steps of", CARD)
    with safe_open(WEIGHTS, framework="pt") as file:
        made = int(file.metadata()["steps"])
    assert made == sum(int(count.replace(",", "")) for count in steps)
    assert not re.search(r"@[A-Z]+@", CARD)
    listed = re.sub(r"\W+", " ", CARD.split("## Looks")[1].split("##")[0])
    assert all(name.replace("-", " ") in listed for name in LOOKS)


def test_their_size_is_the_largest_of_the_training(small):
    sizes = [int(size) for size in re.findall(r"steps of \d+ at (\d+)", CARD)]
    assert small.capabilities.best_size == max(sizes)


@pytest.fixture(scope="module")
def edited():
    """The demo's bear before and after an instruction."""
    solid = demo_scene()
    picture = solid.trace(ring_cameras(solid, 8, 96)[0], 2).image.float()[None]
    settings = SamplerSettings(steps=10, precision="float32")

    def edit(prompt):
        batch, generator = EditBatch(picture, picture, prompt), torch.Generator().manual_seed(0)
        *_, last = make_editor("small").edit(batch, settings, generator)
        return picture, last.images

    return edit


def colorfulness(picture):
    return float((picture.amax(-1) - picture.amin(-1)).mean())


def test_looks_that_a_number_tells_are_followed(edited):
    before, grey = edited("make it black and white")
    assert colorfulness(grey) < 0.5 * colorfulness(before)
    _, night = edited("make it night")
    assert float(night.mean()) < 0.6 * float(before.mean())
    _, negative = edited("show it as a negative")
    assert torch.corrcoef(torch.stack((before.flatten(), negative.flatten())))[0, 1] < -0.8
