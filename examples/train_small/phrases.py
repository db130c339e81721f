"""Sentences that ask for a look: those to train with, and others to test with.

Sentences for training and held-out sentences take different wordings and frames (and nouns, of a
subject's look), so they never meet.
"""

from __future__ import annotations

import itertools
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache

import torch

from gsedit.editors.small.text import MAX_WORDS, words_of
from train_small.target_edits import TRUTHS
from train_small.wordings import WORDINGS

LONGEST = 18  # words of a sentence
HELD_OUT_PAIRS = 5  # one pair in so many is never trained
LOST, REPLACED = 0.15, 0.4  # of a garbled sentence's words
SYLLABLE = (
    ("b", "c", "d", "f", "g", "h", "l", "m", "n", "p", "r", "s", "t", "v", "w", "st", "th", "br"),
    ("a", "e", "i", "o", "u", "ea", "ou"),
    ("", "", "", "d", "l", "n", "r", "s", "t", "ng"),
)

PHRASES: dict[str, tuple[str, ...]] = {
    name: wording.fragments() for name, wording in WORDINGS.items()
}
"""Per look the fragments that training sentences are built of."""

COMMON = 3
"""A word that is said of more looks than this does not tell which one is meant."""
IDLE = frozenset(
    (
        *("after", "age", "all", "among", "and", "at", "bit", "by", "down", "during", "fill"),
        *("have", "increase", "into", "is", "more", "move", "much", "over", "put", "raise", "s"),
        *("seen", "show", "take", "to", "under", "up", "without"),
    )
)
"""Words that are said of few looks and mean none of them."""
VAGUE = frozenset(("bright", "dark", "light", "color", "colors", "colour", "colours"))
"""Words that are said of many looks and still mean something."""


@lru_cache(maxsize=1)
def telling_words() -> frozenset[str]:
    """Words that name a look, or a few: what an instruction should have one of."""
    return frozenset(word for word, looks in _said().items() if looks <= COMMON) - IDLE


@lru_cache(maxsize=1)
def _idle_words() -> tuple[str, ...]:
    """Words of the sentences that do not tell which look is meant."""
    return tuple(sorted(_said().keys() - telling_words() - VAGUE))


def _said() -> Counter[str]:
    """Every word of the fragments and of the looks' names: of how many looks it is said."""
    words = ({*words_of(" ".join(PHRASES[name])), *words_of(name)} for name in PHRASES)
    return Counter(itertools.chain.from_iterable(words))


NOUNS = (
    *("it", "this", "him", "the object", "the statue", "the bear", "the dog", "the vase"),
    *("the cat", "the man", "the woman", "the person", "the horse", "the sculpture", "the bust"),
    *("the lion", "the chair", "the car", "the house", "the tree", "the bird", "the bunny"),
    *("the dragon", "the elephant", "the monument", "the animal", "the teddy bear", "the pot"),
    *("the subject", "that", "the lamp", "the table", "the fountain", "the ball", "the duck"),
)
HELD_OUT_NOUNS = ("the figure", "the toy", "the fox", "the cup", "the thing", "the robot")

THING_FRAMES = (
    *("turn {it} into {look}", "{it} as {look}", "as {look}", "as {look}", "make {it} {look}"),
    *("make {it} look like {look}", "change {it} into {look}", "what if {it} were {look}"),
    *("transform {it} into {look}", "I want {look}", "{look}", "make {it} into {look}"),
    *("replace {it} with {look}", "it should be {look}", "convert {it} to {look}"),
)
STATE_FRAMES = (
    *("{look}", "show {it} {look}", "{it} {look}", "what if {it} were {look}"),
    *("make {it} look as if it were {look}", "I want to see {it} {look}"),
)
CHANGE_FRAMES = ("make {it} {look}", "can you make {it} {look}", "I want you to make {it} {look}")
ORDER_FRAMES = ("{look}", "{look}", "{look}", "you should {look}", "now {look}")
HELD_THING_FRAMES = ("could this become {look}", "imagine that {it} is {look}")
HELD_STATE_FRAMES = ("imagine {it} {look}", "how would {it} look {look}")
HELD_ORDER_FRAMES = ("would you kindly {look}", "go ahead and {look}")

COURTESIES = ("please {ask}", "{ask} please", "{ask}, please")
ENDS = ("", "", "", ".", "!")


def held_out_pair(first: str, second: str) -> bool:
    """Whether two looks are kept apart in training: about one pair in five, in either order."""
    key = "+".join(sorted((first, second)))
    return zlib.crc32(key.encode()) % HELD_OUT_PAIRS == 0


def training_prompt(names: Sequence[str], generator: torch.Generator) -> str:
    """A random sentence that asks for one or two looks."""
    ordered = sorted(names, key=lambda name: TRUTHS[name].scope == "scene")
    while True:
        asks = _pair(ordered, generator) if len(ordered) == 2 else _single(ordered[0], generator)
        sentence = _finished(asks, generator)
        if len(sentence.split()) <= LONGEST:
            return sentence


def garbled(sentence: str, generator: torch.Generator, borrowed: float = 0.0) -> str:
    """The same look asked for in a stranger's words: of those that do not tell which one it is,
    some are replaced and some left out, and more are put in between. The strange ones are nonsense,
    or by a share `borrowed` from the sentences of any look: else "all", which only black and white
    happens to be asked for with, would mean that. Without a word that tells it stays as it is."""
    if not telling_words().intersection(words_of(sentence)):
        return sentence
    said = list[str]()
    for word in sentence.split():
        if _number(8, generator) == 0:
            said.append(_strange(generator, borrowed))
        if telling_words().intersection(words_of(word)):
            said.append(word)
            continue
        fate = float(torch.rand((), generator=generator))
        if fate >= LOST:
            said.append(_strange(generator, borrowed) if fate < LOST + REPLACED else word)
    return " ".join(said[:MAX_WORDS])


def _strange(generator: torch.Generator, borrowed: float) -> str:
    if borrowed and float(torch.rand((), generator=generator)) < borrowed:
        return pick(_idle_words(), generator)
    return _nonsense(generator)


def _nonsense(generator: torch.Generator) -> str:
    """A word of one to three syllables that names no look."""
    while True:
        count = 1 + _number(3, generator)
        word = "".join(pick(sounds, generator) for _ in range(count) for sounds in SYLLABLE)
        if word not in telling_words():
            return word


def held_out_prompts(names: Sequence[str]) -> tuple[str, ...]:
    """Sentences that `training_prompt` never says: first those in wordings that it does not know,
    then known ones in frames that it does not know. A subject's have nouns of their own."""
    ordered = sorted(names, key=lambda name: TRUTHS[name].scope == "scene")
    singles = [tuple(_held_out_single(name)) for name in ordered]
    if len(singles) == 1:
        return singles[0]
    states = _held_states(ordered[1])
    pairs = itertools.product(singles[0][:4], states[:2])
    return tuple(f"{first}, {second}" for first, second in pairs)


def _held_out_single(name: str) -> Iterable[str]:
    wording = WORDINGS[name]
    nouns = itertools.cycle(HELD_OUT_NOUNS if TRUTHS[name].scope == "subject" else ("it", "this"))
    for look, frame in zip(wording.held_things, itertools.cycle(HELD_THING_FRAMES)):
        yield frame.format(look=look, it=next(nouns))
    for look, frame in zip(wording.held_states, itertools.cycle(HELD_STATE_FRAMES)):
        yield frame.format(look=look, it=next(nouns))
    for look, frame in zip(wording.held_orders, itertools.cycle(("{look}", *HELD_ORDER_FRAMES))):
        yield frame.format(look=look.format(it=next(nouns)))
    yield HELD_STATE_FRAMES[0].format(look=wording.states[0], it=next(nouns))
    yield HELD_THING_FRAMES[1].format(look=wording.things[0], it=next(nouns))


def _held_states(name: str) -> tuple[str, ...]:
    return (*WORDINGS[name].held_states, *WORDINGS[name].states)


def _single(name: str, generator: torch.Generator) -> str:
    """One look's clause, without capitals and courtesy."""
    wording = WORDINGS[name]
    forms = (
        (THING_FRAMES, wording.things),
        (STATE_FRAMES, wording.states),
        (ORDER_FRAMES, wording.orders),
        (CHANGE_FRAMES, wording.changes),
    )
    frames, looks = forms[_number(4, generator)]
    it = _noun(name, generator)
    look = pick(looks, generator).format(it=it)
    return pick(frames, generator).format(look=look, it=it)


def _pair(names: Sequence[str], generator: torch.Generator) -> str:
    """Both looks in one sentence; a state of the second mostly trails the first."""
    first, second = names
    clause = _single(first, generator)
    if _number(4, generator):
        trailing = pick(WORDINGS[second].states, generator)
        if _number(6, generator) == 0:
            return f"{trailing}, {clause}"
        return f"{clause}{pick((' ', ', ', ', ', ' and '), generator)}{trailing}"
    order = pick(WORDINGS[second].orders, generator).format(it="it")
    return f"{clause}{pick((' and ', ', then ', ' and then '), generator)}{order}"


def _noun(name: str, generator: torch.Generator) -> str:
    """What the look is asked of: half of the time only "it", more often for a scene's look."""
    plain = 2 if TRUTHS[name].scope == "subject" else 5
    return pick(NOUNS, generator) if _number(plain, generator) == 0 else "it"


def _finished(ask: str, generator: torch.Generator) -> str:
    """With or without courtesy, capital and full stop."""
    if _number(6, generator) == 0:
        ask = pick(COURTESIES, generator).format(ask=ask)
    style = _number(10, generator)
    if style < 4:
        ask = ask[0].upper() + ask[1:]
    elif style == 4:
        ask = ask.upper()
    return ask + pick(ENDS, generator)


def pick(choices: Sequence[str], generator: torch.Generator) -> str:
    return choices[_number(len(choices), generator)]


def _number(below: int, generator: torch.Generator) -> int:
    return int(torch.randint(below, (), generator=generator))
