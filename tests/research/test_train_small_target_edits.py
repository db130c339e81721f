"""Target edits of the small editor: looks that differ clearly, and prompts that ask for them."""

import itertools
import re

import pytest
import torch
from research.train_small.pictures import procedural
from research.train_small.prompts import (
    HELD_OUT_NOUNS,
    LONGEST,
    NOUNS,
    PHRASES,
    held_out_pair,
    held_out_prompts,
    training_prompt,
)
from research.train_small.sources import FAR, Sources
from research.train_small.target_edits import NO_VARIATION, TARGET_EDITS, Variation, target_images

BETWEEN, FROM_ORIGINAL = 0.07, 0.08  # RMSE, mean over the pictures
NAMES = tuple(TARGET_EDITS)
ORIGINAL = "(as it was)"


@pytest.fixture(scope="module")
def pictures() -> Sources:
    """Scenes of all kinds in the size that is trained."""
    return procedural(10, 64, torch.Generator().manual_seed(5))


@pytest.fixture(scope="module")
def targets(pictures) -> dict[str, torch.Tensor]:
    return {name: target_images(pictures, [name]) for name in NAMES}


def of_the_subject(*names: str) -> bool:
    return all(name == ORIGINAL or TARGET_EDITS[name].scope == "subject" for name in names)


def distance(first, second, share) -> float:
    """RMSE where `share` is 1, the mean over the pictures."""
    squares = ((first - second).square().mean(-1, keepdim=True) * share).sum((1, 2, 3))
    return float((squares / share.sum((1, 2, 3)).clamp_min(1)).sqrt().mean())


def plain(sentence: str) -> str:
    return " ".join(re.findall("[a-z]+", sentence.lower()))


def flat(color: float, *, subject: float, depth: float) -> Sources:
    """One picture of one grey, its surface unknown."""
    share = torch.full((1, 24, 32, 1), subject)
    image = torch.full((1, 24, 32, 3), color)
    return Sources(image, torch.full_like(share, depth), torch.zeros_like(image), share)


def test_there_are_enough_looks_of_both_scopes():
    assert len(TARGET_EDITS) >= 46
    assert all(name == edit.name for name, edit in TARGET_EDITS.items())
    assert {edit.scope for edit in TARGET_EDITS.values()} == {"subject", "scene"}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "extreme",
    [
        flat(0.0, subject=1.0, depth=1.0),
        flat(1.0, subject=1.0, depth=1.0),
        flat(0.7, subject=0.0, depth=FAR),
        flat(0.0, subject=0.0, depth=0.0),
    ],
    ids=["black", "white", "sky", "nothing"],
)
def test_extreme_pictures_give_colors(name, extreme):
    variation = Variation(1.15, -10.0, 0.75)
    for result in (target_images(extreme, [name]), target_images(extreme, [name], variation)):
        assert result.shape == extreme.image.shape
        assert result.isfinite().all()
        assert result.min() >= 0
        assert result.max() <= 1


def test_a_subject_look_leaves_the_rest_exactly(pictures, targets):
    outside = (pictures.subject == 0).expand_as(pictures.image)
    assert outside.any()
    variation = Variation(0.9, 8.0, 0.8)
    for name in filter(of_the_subject, NAMES):
        for result in (targets[name], target_images(pictures, [name], variation)):
            assert torch.equal(result[outside], pictures.image[outside]), name


def test_a_weaker_variation_lies_between_the_original_and_the_edit(pictures, targets):
    half = target_images(pictures, ["gold"], Variation(1.0, 0.0, 0.5))
    torch.testing.assert_close(half, (pictures.image + targets["gold"]) / 2, atol=1e-6, rtol=0)


def test_any_two_looks_are_clearly_different_pictures(pictures, targets):
    everywhere = torch.ones_like(pictures.subject)
    images = {ORIGINAL: pictures.image, **targets}
    rows = sorted(
        (
            distance(
                images[a], images[b], pictures.subject if of_the_subject(a, b) else everywhere
            ),
            a,
            b,
        )
        for a, b in itertools.combinations(images, 2)
        if ORIGINAL not in (a, b) or of_the_subject(a, b) or not of_the_subject(b)
    )
    print(*(f"{error:.3f} {a} / {b}" for error, a, b in rows[:10]), sep="\n")  # noqa: T201
    for error, a, b in rows:
        assert error >= (FROM_ORIGINAL if ORIGINAL in (a, b) else BETWEEN), (a, b)


def test_variations_stay_within_their_limits():
    generator = torch.Generator().manual_seed(0)
    variations = [Variation.random(generator) for _ in range(500)]
    assert all(0.85 <= variation.gain <= 1.15 for variation in variations)
    assert all(-10 <= variation.hue <= 10 for variation in variations)
    assert all(0.75 <= variation.amount <= 1 for variation in variations)
    assert len(set(variations)) == len(variations)
    assert (NO_VARIATION.gain, NO_VARIATION.hue, NO_VARIATION.amount) == (1, 0, 1)


def test_variations_stay_nearest_to_their_own_look(pictures, targets):
    """Over several pictures at once, since some looks change little in some pictures.

    About one variation in a hundred is nearer to another look: the weakest and darkest of them.
    """
    generator = torch.Generator().manual_seed(1)
    goals = torch.stack([pictures.image, *targets.values()])[:, :6]
    few = Sources(*(field[:6] for field in pictures))
    wrong = []
    for name in NAMES:
        for _ in range(2):
            drawn = target_images(few, [name], Variation.random(generator))
            nearest = int((goals - drawn).square().mean((1, 2, 3, 4)).argmin())
            if (ORIGINAL, *NAMES)[nearest] != name:
                wrong.append((name, (ORIGINAL, *NAMES)[nearest]))
    assert len(wrong) <= 0.03 * 2 * len(NAMES), wrong


def test_of_two_looks_the_subject_is_changed_first(pictures):
    together = target_images(pictures, ["night", "gold"])
    assert torch.equal(together, target_images(pictures, ["gold", "night"]))
    gold = pictures._replace(image=target_images(pictures, ["gold"]))
    torch.testing.assert_close(together, target_images(gold, ["night"]))


def test_a_look_is_the_same_in_any_batch(pictures, targets):
    alone = Sources(*(field[3:4] for field in pictures))
    for name in ("gold", "sketch", "sunset", "snow"):
        torch.testing.assert_close(target_images(alone, [name]), targets[name][3:4])


@pytest.mark.parametrize("name", NAMES)
def test_every_look_has_sentences_and_held_out_ones_that_are_never_trained(name):
    generator = torch.Generator().manual_seed(2)
    trained = {plain(training_prompt([name], generator)) for _ in range(300)}
    held_out = held_out_prompts([name])
    assert 8 <= len(PHRASES[name]) <= 16
    assert len(trained) > 60
    assert len(set(held_out)) >= 3
    assert all(len(sentence.split()) <= LONGEST for sentence in (*trained, *held_out))
    assert not trained & {plain(sentence) for sentence in held_out}
    assert not any("{" in sentence for sentence in (*PHRASES[name], *trained, *held_out))


@pytest.mark.parametrize("name", NAMES)
def test_a_held_out_sentence_names_its_look_in_trained_words(name):
    words_by_look = {
        look: set(plain(" ".join(phrases)).split()) for look, phrases in PHRASES.items()
    }
    rare = {
        word
        for word in words_by_look[name]
        if sum(word in words for words in words_by_look.values()) <= 5
    }
    for sentence in held_out_prompts([name]):
        assert rare & set(plain(sentence).split()), (sentence, rare)


def test_two_looks_make_one_sentence():
    generator = torch.Generator().manual_seed(3)
    trained = {plain(training_prompt(["bronze", "night"], generator)) for _ in range(500)}
    assert any(sentence.startswith("as a bronze statue ") for sentence in trained)
    assert any(sentence.endswith("bronze statue at night") for sentence in trained)
    held_out = held_out_prompts(["bronze", "night"])
    assert len(held_out) >= 3
    assert not trained & {plain(sentence) for sentence in held_out}
    assert all(len(sentence.split()) <= LONGEST for sentence in held_out)


def test_the_plainest_sentences_are_trained():
    generator = torch.Generator().manual_seed(4)
    bronze = {plain(training_prompt(["bronze"], generator)) for _ in range(1000)}
    snow = {plain(training_prompt(["snow"], generator)) for _ in range(500)}
    assert {"as a bronze statue", "make it bronze"} <= bronze
    assert "make it snow" in snow


def test_held_out_nouns_are_not_trained():
    assert not set(NOUNS) & set(HELD_OUT_NOUNS)


def test_a_fifth_of_the_pairs_is_held_out_in_either_order():
    subjects = [name for name in NAMES if TARGET_EDITS[name].scope == "subject"]
    scenes = [name for name in NAMES if TARGET_EDITS[name].scope == "scene"]
    pairs = list(itertools.product(subjects, scenes))
    assert all(held_out_pair(a, b) == held_out_pair(b, a) for a, b in pairs)
    assert sum(held_out_pair(a, b) for a, b in pairs) / len(pairs) == pytest.approx(0.2, abs=0.03)
