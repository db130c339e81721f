"""Prompts that ask for a look: those of the training, and others held out for evaluation.

Training prompts and held-out prompts use different wordings and frames (and nouns, for a subject's
look), so no prompt is in both sets.
"""

from __future__ import annotations

import itertools
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache

import torch

from gsedit.editors.small.text import MAX_WORDS, words_of
from research.train_small.target_edits import TARGET_EDITS
from research.train_small.wordings import WORDINGS

LONGEST = 18  # words of a prompt
HELD_OUT_PAIRS = 5  # one pair of looks in so many is never trained
DROPPED, REPLACED = 0.15, 0.4  # shares of an augmented prompt's words that name no look
SYLLABLE = (
    ("b", "c", "d", "f", "g", "h", "l", "m", "n", "p", "r", "s", "t", "v", "w", "st", "th", "br"),
    ("a", "e", "i", "o", "u", "ea", "ou"),
    ("", "", "", "d", "l", "n", "r", "s", "t", "ng"),
)

PHRASES: dict[str, tuple[str, ...]] = {
    name: wording.fragments() for name, wording in WORDINGS.items()
}
"""By name of the look: the phrases that training prompts are built of."""

MAX_LOOKS = 3
"""A word in the phrases of more looks than this does not name a look."""
FILLER_WORDS = frozenset(
    (
        *("after", "age", "all", "among", "and", "at", "bit", "by", "down", "during", "fill"),
        *("have", "increase", "into", "is", "more", "move", "much", "over", "put", "raise", "s"),
        *("seen", "show", "take", "to", "under", "up", "without"),
    )
)
"""Words in the phrases of few looks that name none of them."""
AMBIGUOUS_WORDS = frozenset(("bright", "dark", "light", "color", "colors", "colour", "colours"))
"""Words in the phrases of many looks that still have a meaning for them."""


@lru_cache(maxsize=1)
def look_words() -> frozenset[str]:
    """Words that name a look, or a few: an instruction should have at least one of them."""
    counts = _look_counts()
    return frozenset(word for word, looks in counts.items() if looks <= MAX_LOOKS) - FILLER_WORDS


@lru_cache(maxsize=1)
def _distractors() -> tuple[str, ...]:
    """Words of the phrases that name no look."""
    return tuple(sorted(_look_counts().keys() - look_words() - AMBIGUOUS_WORDS))


def _look_counts() -> Counter[str]:
    """In how many looks' phrases or names each word is."""
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
HELD_OUT_THING_FRAMES = ("could this become {look}", "imagine that {it} is {look}")
HELD_OUT_STATE_FRAMES = ("imagine {it} {look}", "how would {it} look {look}")
HELD_OUT_ORDER_FRAMES = ("would you kindly {look}", "go ahead and {look}")

COURTESIES = ("please {clause}", "{clause} please", "{clause}, please")
ENDS = ("", "", "", ".", "!")


def held_out_pair(first: str, second: str) -> bool:
    """Whether two looks are kept apart in training: about one pair in five, in either order."""
    key = "+".join(sorted((first, second)))
    return zlib.crc32(key.encode()) % HELD_OUT_PAIRS == 0


def training_prompt(names: Sequence[str], generator: torch.Generator) -> str:
    """A random prompt for one or two looks, of at most LONGEST words."""
    ordered = sorted(names, key=lambda name: TARGET_EDITS[name].scope == "scene")
    while True:
        clause = _pair(ordered, generator) if len(ordered) == 2 else _single(ordered[0], generator)
        prompt = _punctuated(clause, generator)
        if len(prompt.split()) <= LONGEST:
            return prompt


def augmented(prompt: str, generator: torch.Generator, distractors: float = 0.0) -> str:
    """The prompt with words inserted, and with words that name no look replaced or dropped.

    New words are nonsense, or by a share `distractors` words of any look's prompts that name no
    look: else "all", which is only in prompts for black and white, would come to mean that look. A
    prompt without any look word is returned as it is.
    """
    if not look_words().intersection(words_of(prompt)):
        return prompt
    words = list[str]()
    for word in prompt.split():
        if _number(8, generator) == 0:
            words.append(_new_word(generator, distractors))
        if look_words().intersection(words_of(word)):
            words.append(word)
            continue
        u = float(torch.rand((), generator=generator))
        if u >= DROPPED:
            words.append(_new_word(generator, distractors) if u < DROPPED + REPLACED else word)
    return " ".join(words[:MAX_WORDS])


def _new_word(generator: torch.Generator, distractors: float) -> str:
    if distractors and float(torch.rand((), generator=generator)) < distractors:
        return pick(_distractors(), generator)
    return _nonsense(generator)


def _nonsense(generator: torch.Generator) -> str:
    """A word of one to three syllables that names no look."""
    while True:
        count = 1 + _number(3, generator)
        word = "".join(pick(sounds, generator) for _ in range(count) for sounds in SYLLABLE)
        if word not in look_words():
            return word


def held_out_prompts(names: Sequence[str]) -> tuple[str, ...]:
    """Prompts that `training_prompt` never returns: first those in held-out wordings, then trained
    wordings in held-out frames. Those for a subject's look have held-out nouns."""
    ordered = sorted(names, key=lambda name: TARGET_EDITS[name].scope == "scene")
    singles = [tuple(_held_out_single(name)) for name in ordered]
    if len(singles) == 1:
        return singles[0]
    states = _states(ordered[1])
    pairs = itertools.product(singles[0][:4], states[:2])
    return tuple(f"{first}, {second}" for first, second in pairs)


def _held_out_single(name: str) -> Iterable[str]:
    wording = WORDINGS[name]
    nouns = itertools.cycle(
        HELD_OUT_NOUNS if TARGET_EDITS[name].scope == "subject" else ("it", "this")
    )
    for look, frame in zip(wording.held_out_things, itertools.cycle(HELD_OUT_THING_FRAMES)):
        yield frame.format(look=look, it=next(nouns))
    for look, frame in zip(wording.held_out_states, itertools.cycle(HELD_OUT_STATE_FRAMES)):
        yield frame.format(look=look, it=next(nouns))
    for look, frame in zip(
        wording.held_out_orders, itertools.cycle(("{look}", *HELD_OUT_ORDER_FRAMES))
    ):
        yield frame.format(look=look.format(it=next(nouns)))
    yield HELD_OUT_STATE_FRAMES[0].format(look=wording.states[0], it=next(nouns))
    yield HELD_OUT_THING_FRAMES[1].format(look=wording.things[0], it=next(nouns))


def _states(name: str) -> tuple[str, ...]:
    """Return states, held-out ones first."""
    return (*WORDINGS[name].held_out_states, *WORDINGS[name].states)


def _single(name: str, generator: torch.Generator) -> str:
    """A clause that asks for one look."""
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
    """A clause that asks for two looks: mostly the first, followed by a state of the second."""
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
    """The noun for the subject: "it" half of the time, and more often for a scene's look."""
    one_in = 2 if TARGET_EDITS[name].scope == "subject" else 5
    return pick(NOUNS, generator) if _number(one_in, generator) == 0 else "it"


def _punctuated(clause: str, generator: torch.Generator) -> str:
    """With or without "please", capitals and final punctuation."""
    if _number(6, generator) == 0:
        clause = pick(COURTESIES, generator).format(clause=clause)
    style = _number(10, generator)
    if style < 4:
        clause = clause[0].upper() + clause[1:]
    elif style == 4:
        clause = clause.upper()
    return clause + pick(ENDS, generator)


def pick(choices: Sequence[str], generator: torch.Generator) -> str:
    return choices[_number(len(choices), generator)]


def _number(below: int, generator: torch.Generator) -> int:
    return int(torch.randint(below, (), generator=generator))
