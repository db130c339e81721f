"""Training prompts: look words, augmentation, held-out wordings."""

from __future__ import annotations

import pytest
import torch
from research.train_small.prompts import (
    PHRASES,
    augmented,
    held_out_prompts,
    look_words,
    training_prompt,
)
from research.train_small.target_edits import TARGET_EDITS

from gsedit.editors.small.text import MAX_WORDS, words_of


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("name", TARGET_EDITS)
def test_augmented_prompts_keep_their_look_words(name):
    generator, names = seeded(), look_words()
    plain = [training_prompt((name,), generator) for _ in range(20)]
    varied = [augmented(sentence, generator) for sentence in plain]
    for sentence, other in zip(plain, varied):
        kept = [word for word in words_of(sentence) if word in names]
        assert [word for word in words_of(other) if word in names] == kept
        assert kept or other == sentence
        assert len(words_of(other)) <= MAX_WORDS
    assert sum(a != b for a, b in zip(plain, varied)) > 10


def test_look_words_are_separated_from_the_others():
    words = look_words()
    assert {"bronze", "snow", "snowy", "sketch", "foggy", "red"} <= words
    assert not {"a", "it", "the", "make", "in", "statue", "into", "and", "put", "up"} & words
    assert all(words & set(name.split("-")) for name in TARGET_EDITS)
    others = [f for name in PHRASES for f in PHRASES[name] if not words & set(words_of(f))]
    assert all({"bright", "dark", "light", "color", "colour"} & set(words_of(f)) for f in others)


@pytest.mark.parametrize("name", TARGET_EDITS)
def test_the_first_held_out_prompts_use_no_trained_phrase(name):
    own = name.replace("-", " ")
    trained = [f for f in PHRASES[name] if len(f.split()) > 2 and f != own]
    for sentence in held_out_prompts((name,))[:2]:
        assert not [fragment for fragment in trained if fragment in sentence]
