"""The weights that come with gsedit: what their card says of them, and that they do it."""

import json
import re

import pytest
import torch
from safetensors import safe_open
from train_small import Case, summary
from train_small.phrases import held_out_prompts, telling_words
from train_small.pictures import procedural
from train_small.scoring import score
from train_small.target_edits import TRUTHS
from train_small.train import CHUNKS, ROUNDS, SEED

from gsedit.diffusion import SamplerSettings
from gsedit.editors import make_editor
from gsedit.editors.small import DEFAULTS, WEIGHTS, load_small

CARD = WEIGHTS.with_name("MODEL_CARD.md").read_text(encoding="utf-8")
LOOKS = ("verdigris", "jade", "green", "snow", "night", "sunset", "sketch", "sepia", "thermal")


@pytest.fixture(scope="module")
def small():
    return load_small()


def test_they_fit_in_the_package():
    assert WEIGHTS.stat().st_size <= 16e6
    with safe_open(WEIGHTS, framework="pt") as file:
        assert {str(file.get_tensor(name).dtype) for name in file.keys()} == {"torch.float16"}  # noqa: SIM118


def test_they_are_those_of_the_script_to_its_end():
    with safe_open(WEIGHTS, framework="pt") as file:
        told = file.metadata()
    assert told["seed"] == str(SEED)
    assert told["steps"] == str(sum(phase.steps for phases in ROUNDS for phase in phases))
    assert json.loads(told["looks"]) == list(TRUTHS)


def test_they_know_what_they_were_taught(small):
    assert small.looks == tuple(TRUTHS)
    assert small.words == telling_words()


def test_the_card_says_how_they_came_about(small):
    weights = sum(value.numel() for value in small.network.state_dict().values())
    assert f"{weights / 1e6:.1f} M weights" in CARD
    assert f"{WEIGHTS.stat().st_size / 1e6:.1f} MB" in CARD
    s_T, s_I, temperature = DEFAULTS
    assert f"s_T {s_T:g}, s_I {s_I:g}, starting noise of {temperature:g}" in CARD
    assert f"{sum(chunk.procedural + chunk.traced for chunk in CHUNKS):,} pictures" in CARD
    assert not re.search(r"@[A-Z]+@", CARD)
    for phases in ROUNDS:
        for phase in phases:
            assert f"{phase.steps:,} steps of {phase.batch} at {phase.size}" in CARD
    taught = re.sub(r"\W+", " ", CARD.split("## What it was taught")[1].split("##")[0])
    assert all(name.replace("-", " ") in taught for name in TRUTHS)


def test_a_sentence_it_was_not_taught_gets_a_remark():
    advice = make_editor("small").capabilities.advice
    assert "so the result is a guess" in advice("give it a moustache")
    assert not advice("as a bronze statue")


def test_held_out_sentences_are_followed_on_pictures_it_never_saw():
    """LOOKS are among the plainest; of all 51 the card tells. Two pictures of each."""
    pictures = procedural(2 * len(LOOKS), 96, torch.Generator().manual_seed(9100))
    cases = [
        Case(pictures.rows(torch.tensor([2 * i, 2 * i + 1])), (name,), held_out_prompts((name,))[0])
        for i, name in enumerate(LOOKS)
    ]
    settings = SamplerSettings(steps=10, precision="float32")
    found = summary(list(score(make_editor("small"), cases, settings)))
    assert found.nearest >= 0.8
    assert found.gain >= 4
