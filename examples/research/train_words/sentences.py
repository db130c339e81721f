"""The sentences that the head of the reader is trained on, with their looks.

Whatever is in tests/words/ decides, and is never used here.
"""

from __future__ import annotations

import colorsys
import random
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from gsedit.words.reader import SCENE_LOOKS, SUBJECT_LOOKS
from research.train_small.wordings import WORDINGS

NONE = "none"
PARAPHRASES = Path(__file__).with_name("paraphrases.txt")
PAIRS = 5000
FRAMES_OF_A_PHRASE = 2

FRAMES = (
    *("make it {}", "make it look like {}", "turn it into {}", "{} please", "I want {}"),
    *("can you make it look like {}", "as if it was {}", "it should look {}", "show me {}"),
    *("give it the look of {}", "the whole thing {}", "change the picture to {}", "{} style"),
    *("something like {}", "like {}", "my statue as {}", "could it be {}", "how about {}"),
    *("with the look of {}", "the bear {}", "imagine {}", "i would like to see {}", "{}!"),
    *("{}, thank you", "transform the animal: {}", "he should be {}", "do {}", "maybe {}"),
    "a version with {}",
)
NONE_FRAMES = (
    *("can you {}", "please {}", "I want you to {}", "could you {}", "now {}"),
    *("{} please", "{} for me", "{} now", "{}, thanks"),
)
JOINTS = (
    *("{a}, {b}", "{b}, {a}", "{a} and {b}", "{b} and {a}", "{a} with {b}", "{a} in {b}"),
    *("{a}, in {b}", "{a} but {b}", "{a}, seen as {b}", "{a} during {b}", "{a}; also {b}"),
    *("turn it into {a} and the scene into {b}", "make it {a}, and make everything {b}"),
    *("{b} with {a} in the middle", "I want {a}, then {b}"),
    "make the bear {a} and the picture {b}",
)
NOUNS = (
    *("statue", "dog", "vase", "man", "horse", "chair", "car", "house", "bird", "dragon"),
    *("elephant", "monument", "animal", "lamp", "fountain", "duck", "thing", "face"),
)
PAINT_FRAMES = (
    *("paint the {noun} {look}", "use {look} paint on the {noun}", "a {look} {noun}"),
    *("make the {noun} {look}", "colour the {noun} {look}", "the {noun} in {look}"),
)
MATERIAL_FRAMES = (
    *("a {look} {noun}", "the {noun} made of {look}", "make the {noun} out of {look}"),
    *("use {look} for the {noun}", "turn the {noun} into {look}", "a {noun} in solid {look}"),
)
NOUN_FRAMES = 8
"""For each of the subject's looks."""
PAINTS = {
    **{name: name for name in ("red", "orange", "yellow", "green", "blue", "purple", "pink")},
    **{"white": "white", "black": "black", "violet": "purple"},
}
DECISIVE = ("bubblegum",)
"""Names of colours that are a sentence of tests/words/."""
HUES = ((12, "red"), (44, "orange"), (68, "yellow"), (168, "green"), (258, "blue"),
        (295, "purple"), (348, "pink"), (361, "red"))  # fmt: skip
"""Upper ends in degrees."""


class Example(NamedTuple):
    """A sentence and what it asks for."""

    sentence: str
    subject: int
    """Index in SUBJECT_LOOKS; their number means none."""
    scene: int
    weight: float


def phrases() -> dict[str, list[str]]:
    """By look, and NONE: the paraphrases, and the wordings that `small` was trained on."""
    written: dict[str, list[str]] = {}
    for line in PARAPHRASES.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            name, _, parts = line.partition(":")
            written[name] = [part.strip() for part in parts.split("|")]
    trained = {name: wording.fragments() for name, wording in WORDINGS.items()}
    return {
        name: list(dict.fromkeys((*parts, *trained.get(name, ()))))
        for name, parts in written.items()
    }


def examples(seed: int = 0) -> list[Example]:
    """Every phrase, alone and in random frames; looks of nouns; random pairs; names of colours."""
    generator = random.Random(seed)
    known = phrases()
    listed = list[Example]()
    for name, parts in known.items():
        frames = NONE_FRAMES if name == NONE else FRAMES
        for phrase in parts:
            listed.append(Example(phrase, *answers(name), 1.0))
            for frame in generator.sample(frames, FRAMES_OF_A_PHRASE):
                listed.append(Example(frame.format(phrase), *answers(name), 0.5))
    for look in SUBJECT_LOOKS:
        frames = PAINT_FRAMES if look.name in PAINTS else MATERIAL_FRAMES
        for frame in (generator.choice(frames) for _ in range(NOUN_FRAMES)):
            sentence = frame.format(look=look.name, noun=generator.choice(NOUNS))
            listed.append(Example(sentence, *answers(look.name), 1.0))
    for _ in range(PAIRS):
        first, second = generator.choice(SUBJECT_LOOKS).name, generator.choice(SCENE_LOOKS).name
        a, b = generator.choice(known[first]), generator.choice(known[second])
        sentence = generator.choice(JOINTS).format(a=a, b=b)
        listed.append(Example(sentence, answers(first)[0], answers(second)[1], 0.5))
    listed += (Example(name, *answers(paint), 0.3) for name, paint in colour_names())
    return listed


def answers(name: str) -> tuple[int, int]:
    """Target of the head for a phrase of this look: (subject, scene)."""
    subjects, scenes = [look.name for look in SUBJECT_LOOKS], [look.name for look in SCENE_LOOKS]
    subject = subjects.index(name) if name in subjects else len(subjects)
    return subject, scenes.index(name) if name in scenes else len(scenes)


def colour_names() -> Iterator[tuple[str, str]]:
    """(name, paint) of the colours of the xkcd survey (CC0; matplotlib has them) that are one of
    the nine paints: by the name's last word, else by the hue of a saturated colour."""
    from matplotlib.colors import XKCD_COLORS, to_rgb

    for key, value in XKCD_COLORS.items():
        name = key.removeprefix("xkcd:")
        if name in DECISIVE:
            continue
        last = name.split()[-1]
        if last in PAINTS:
            yield name, PAINTS[last]
            continue
        hue, saturation, brightness = colorsys.rgb_to_hsv(*to_rgb(value))
        degrees = 360 * hue
        brown = 12 <= degrees < 45 and brightness < 0.8
        if saturation >= 0.45 and brightness >= 0.45 and not brown:
            yield name, next(paint for end, paint in HUES if degrees < end)
