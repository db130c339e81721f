"""Words of a clause with their meanings, longest phrase first. Reads no weights."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache

from gsedit.words import colors, lexicon, materials
from gsedit.words.lexicon import word_set
from gsedit.words.targets import MARKERS

LONGEST = 4
"""Most words of a phrase of the lexicon."""
FILLERS = word_set(
    "a an the please pls kindly could can would you make made turn turned into paint "
    "painted color change changed give get want i like look looks as if though of to in on "
    "at for with from out be is are was were should ought must may let do now then just "
    "only so too very more this that these those there its his her my your our their some "
    "really nice all by up it want wants need style version it them me us we and or but "
    "coat layer finish finished material appearance feel feeling effect tone tones texture "
    "side half percent thick rendered render swap use using set would could might cover "
    "covered wrap wrapped cast carve carved spray sprayed dye dyed whole thing ones one "
    "first lit under during over light lights day time image picture photo job lol thanks "
    "thank ok see show imagine think maybe perhaps how what about something somewhere kind "
    "sort place instead have has been had looking go going bathe try put fix shift bring "
    "toward towards also please again same morning sky weather colored work solid made "
    "everything will statue bust figurine figure sculpture hi hey hello reckon favor again "
    "current original overall now ground leaves foliage left right front above below top"
)
STATEMENTS = word_set("is are look looks feels feel seems seem appears was were looking")
WISHES = word_set(
    "make turn want like should be get give let paint need ought must could would can "
    "please render set"
)


@dataclass(frozen=True)
class Word:
    """One phrase of a clause."""

    text: str
    kind: str
    """Table it stands in, "mark" for a part of the scene, "unknown" for none."""
    value: str
    at: int
    """Place of its first word in the clause."""
    color: str | None = None


@lru_cache(1)
def phrases() -> dict[str, tuple[str, str]]:
    """(table, meaning) of each phrase; of one in two tables, the later one's."""
    tables = {
        "intense": {word: word for word in lexicon.INTENSE},
        "noun": lexicon.TONE_NOUNS,
        "material": materials.MATERIAL_NAMES,
        "light": lexicon.LIGHTS,
        "look": lexicon.LOOK_NAMES,
        "finish": lexicon.FINISHES,
        "word": lexicon.TONE_WORDS,
        "turn": lexicon.TONE_TURNS,
        "style": lexicon.TONE_STYLES,
        "hue": lexicon.HUES,
        "up": dict.fromkeys(lexicon.UP, ""),
        "down": dict.fromkeys(lexicon.DOWN, ""),
        "slight": dict.fromkeys(lexicon.SLIGHT, ""),
        "strong": dict.fromkeys(lexicon.STRONG, ""),
        "fill": {"snow globe": "", "big moon": "", "deep down": ""},
    }
    return {
        phrase: (kind, meaning)
        for kind, table in tables.items()
        for phrase, meaning in table.items()
    }


def scanned(words: list[str]) -> list[Word]:
    """Phrases of a clause in order."""
    found = list[Word]()
    at = 0
    while at < len(words):
        word, used = _next(words, at)
        found.append(word)
        at += used
    return found


def _next(words: list[str], at: int) -> tuple[Word, int]:
    """The phrase that begins at a word, and how many words it has."""
    if words[at] in MARKERS:
        return Word(words[at], "mark", words[at], at), 1
    if words[at].startswith("#") and (color := colors.hexadecimal(words[at])):
        return Word(color, "color", color, at, color), 1
    phrase = _phrase(words, at)
    hue = (
        colors.longest(words[at : at + 6])
        if words[at] not in ("light", "dark") or len(words) > at + 1
        else None
    )
    if hue and hue[0] > (phrase[0] if phrase else 0):
        text = " ".join(words[at : at + hue[0]])
        return Word(text, "color", text, at, hue[1]), hue[0]
    if phrase:
        used, kind, value = phrase
        return Word(" ".join(words[at : at + used]), kind, value, at, hue and hue[1]), used
    return _single(words[at], at), 1


def _phrase(words: list[str], at: int) -> tuple[int, str, str] | None:
    table = phrases()
    for count in range(min(LONGEST, len(words) - at), 0, -1):
        if entry := table.get(" ".join(words[at : at + count])):
            return (count, *entry)
    return None


def _single(word: str, at: int) -> Word:
    """A word of no phrase: a plain one, a slip of spelling, or an unknown one."""
    if word in FILLERS or word in lexicon.MATERIAL_WORDS or not word.isalpha():
        return Word(word, "fill", "", at)
    if len(word) >= 6:  # fewer letters are too near to other words
        known = [each for each in _spellings() if each[0] == word[0] and word != f"{each}s"]
        if near := get_close_matches(word, known, n=1, cutoff=0.82):
            return (
                Word(near[0], *phrases()[near[0]], at)
                if near[0] in phrases()
                else Word(near[0], "color", near[0], at, colors.named(near[0]))
            )
    return Word(word, "unknown", word, at)


@lru_cache(1)
def _spellings() -> list[str]:
    tables = (materials.MATERIAL_NAMES, lexicon.TONE_NOUNS, lexicon.LOOK_NAMES)
    return [word for table in tables for word in table if " " not in word] + sorted(colors.PLAIN)
