"""The weights that come with gsedit: their model card is true, and they edit as they should."""

import json
import re
from itertools import chain

import pytest
import torch
from research.train_small.evaluation import Case, evaluate, summary
from research.train_small.pictures import procedural
from research.train_small.prompts import held_out_prompts, look_words
from research.train_small.recipe import CHUNKS, ROUNDS, SEED
from research.train_small.target_edits import TARGET_EDITS
from safetensors import safe_open

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import make_editor
from gsedit.editors.small.denoiser import DEFAULTS, load_small
from gsedit.editors.small.shipped import WEIGHTS

CARD = WEIGHTS.with_name("MODEL_CARD.md").read_text(encoding="utf-8")
LOOKS = ("verdigris", "jade", "green", "snow", "night", "sunset", "sketch", "sepia", "thermal")


@pytest.fixture(scope="module")
def small():
    return load_small()


def test_they_fit_in_the_package():
    assert WEIGHTS.stat().st_size <= 16e6
    with safe_open(WEIGHTS, framework="pt") as file:
        assert {str(file.get_tensor(name).dtype) for name in file.keys()} == {"torch.float16"}  # noqa: SIM118


def test_they_are_those_of_the_finished_training():
    with safe_open(WEIGHTS, framework="pt") as file:
        metadata = file.metadata()
    assert metadata["seed"] == str(SEED)
    assert metadata["steps"] == str(sum(phase.steps for phases in ROUNDS for phase in phases))
    assert json.loads(metadata["looks"]) == list(TARGET_EDITS)


def test_they_name_the_looks_of_the_training(small):
    assert small.looks == tuple(TARGET_EDITS)
    assert small.words == look_words()


def test_the_card_states_how_they_were_made(small):
    weights = sum(value.numel() for value in small.network.state_dict().values())
    assert f"{weights / 1e6:.1f} M weights" in CARD
    assert f"{WEIGHTS.stat().st_size / 1e6:.1f} MB" in CARD
    s_T, s_I, temperature, *_ = DEFAULTS
    assert f"s_T {s_T:g}, s_I {s_I:g}, starting noise of {temperature:g}" in CARD
    assert f"{sum(chunk.count for chunk in CHUNKS):,} pictures" in CARD
    assert not re.search(r"@[A-Z]+@", CARD)
    for phases in ROUNDS:
        for phase in phases:
            assert f"{phase.steps:,} steps of {phase.batch} at {phase.size}" in CARD
    listed = re.sub(r"\W+", " ", CARD.split("## Looks")[1].split("##")[0])
    assert all(name.replace("-", " ") in listed for name in TARGET_EDITS)


def test_their_size_is_the_largest_of_the_training(small):
    assert small.capabilities.best_size == max(each.size for each in chain.from_iterable(ROUNDS))


def test_they_know_every_look_that_a_sentence_can_be_understood_as():
    understand = make_editor("small").capabilities.understand
    assert understand is not None
    assert understand("cast it in bronze").names == ("bronze",)


def test_held_out_prompts_are_followed_on_new_pictures():
    """Two pictures of each of LOOKS, which are among the easiest; the card scores all looks."""
    pictures = procedural(2 * len(LOOKS), 96, torch.Generator().manual_seed(9100))
    cases = [
        Case(pictures.rows(torch.tensor([2 * i, 2 * i + 1])), (name,), held_out_prompts((name,))[0])
        for i, name in enumerate(LOOKS)
    ]
    settings = SamplerSettings(steps=10, precision="float32")
    mean = summary(list(evaluate(make_editor("small"), cases, settings)))
    assert mean.nearest >= 0.8
    assert mean.gain >= 4
