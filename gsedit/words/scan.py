"""Words, numbers and marks of a sentence in one spelling, and typed: phrases of the lexicon, colors
and numbers, the longest first."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from gsedit.words import colors, lexicon

SPELLINGS = (
    (r"[\u2018\u2019`]", "'"),
    (r"colou?r", "color"),
    (r"\bgrey", "gray"),
    (r"\bde-(?=[a-z])", "de"),
    (r"\bpercents?\b|\bper cent\b|\bpct\b", "%"),
    (r"(?<=[a-z])-(?=[a-z])", " "),
)
"""Patterns and what stands in their place, in order."""
TOKEN = re.compile(
    r"rgb\s*\([^)]*\)|rgb \d+[, ]+\d+[, ]+\d+|#[0-9a-f]{3,8}\b"
    r"|\b(?=[0-9a-f]*\d)(?=\d*[a-f])[0-9a-f]{6}\b|[+-]?\d+/\d+|[+-]?\d+(?:\.\d+)?|[+-]?\.\d+"
    r"|%|'s\b|<\d+>|[a-z]+|[&/]|[,;.!?:\n]"
)
HEX = re.compile(r"(?=\w*[a-f])(?=\w*\d)[0-9a-f]{6}$")
MARKS = frozenset(",;.!?:\n")


def normalised(sentence: str) -> str:
    """Lower-case ASCII text of a sentence in one spelling."""
    text = unicodedata.normalize("NFKC", sentence).lower()
    for pattern, put in SPELLINGS:
        text = re.sub(pattern, put, text)
    text = text.replace("\u00df", "ss")
    return "".join(each for each in unicodedata.normalize("NFD", text) if each.isascii()).strip()


def tokens(sentence: str) -> list[str]:
    """Words, numbers, "%", "'s", colors by number and marks of a sentence."""
    found = TOKEN.findall(normalised(sentence))
    return ["and" if each in "&/" else f"#{each}" if HEX.match(each) else each for each in found]


DETERMINERS = frozenset(("the", "my", "this", "that", "our", "your", "his", "her", "their"))


@dataclass(frozen=True)
class Word:
    """One phrase of a sentence."""

    text: str
    kind: str
    """Kind of its row in the lexicon; "mark", "color" or "number"; "unknown" for none."""
    value: str
    tags: frozenset[str] = frozenset()
    """Kinds of `lexicon.SETS` that hold it."""
    color: str | None = None
    """Color that its name is, whatever its kind."""
    number: float = 0.0

    def has(self, *tags: str) -> bool:
        """Whether any of these sets holds the word."""
        return not self.tags.isdisjoint(tags)


def scanned(sentence: str) -> list[Word]:
    """Typed words of a sentence in order."""
    rest, found = tokens(sentence), list[Word]()
    while rest:
        word, used = _next(rest)
        found.append(word)
        rest = rest[used:]
    return found


def _next(words: list[str]) -> tuple[Word, int]:
    """The phrase that a list of tokens begins with, and how many of them it has."""
    first = words[0]
    if first in MARKS or first == "'s":
        return Word(first, "poss" if first == "'s" else "mark", first), 1
    if (value := _number(first)) is not None and _phrase(words)[0] < 2:  # "8 bit" is a look
        return Word(first, "number", first, number=value), 1
    if color := colors.hexadecimal(first):
        return Word(color, "color", color, color=color), 1
    if first == "between" and (mixed := _midway(words[1:])):
        return mixed[0], mixed[1] + 1
    used, entry = _phrase(words)
    text = " ".join(words[: max(used, 1)])
    hue = colors.longest(
        [_singular(first) if _singular(first) in colors.PLAIN else first, *words[1:6]]
    )
    plain = entry is not None and entry.kind == "fill"
    if hue and hue[0] > used - plain:
        return _colored(" ".join(words[: hue[0]]), hue[1]), hue[0]
    if entry is None:
        return Word(first, "unknown", first), 1
    number = float(entry.value) if entry.kind in ("number", "factor", "fraction") else 0.0
    color = hue[1] if hue and hue[0] == used else None
    return Word(text, entry.kind, entry.value, _tags(text), color, number), used


def _phrase(words: list[str]) -> tuple[int, lexicon.Entry | None]:
    """(words used, meaning) of the longest phrase of the lexicon; (0, None) for none."""
    table = lexicon.entries()
    for count in range(min(lexicon.LONGEST, len(words)), 0, -1):
        text = " ".join(words[:count])
        for each in (text, _singular(text)):
            if each in table:
                return count, table[each]
    return 0, None


def _singular(text: str) -> str:
    return text[:-1] if text.endswith("s") and len(text) > 3 else text


def _tags(text: str) -> frozenset[str]:
    return frozenset(kind for kind, phrases in lexicon.sets().items() if text in phrases)


def _colored(text: str, color: str) -> Word:
    """A color, or a material that a color stands before: "dark chocolate"."""
    last = text.split()[-1]
    entry = lexicon.entries().get(last)
    if entry and entry.kind == "material" and last != text and not _tags(last) & {"tinge"}:
        return Word(text, "material", entry.value, _tags(text), color)
    return Word(text, "color", text, _tags(text), color)


def _midway(words: list[str]) -> tuple[Word, int] | None:
    """Color midway of "teal and blue", and how many words it has."""
    first = colors.longest(words) if words else None
    if not first or words[first[0] : first[0] + 1] != ["and"]:
        return None
    second = colors.longest(words[first[0] + 1 :]) if words[first[0] + 1 :] else None
    if not second:
        return None
    used = first[0] + 1 + second[0]
    color, name = colors.between(first[1], second[1]), " ".join(words[:used])
    return Word(f"between {name}", "color", f"between {name}", color=color), used


def _number(token: str) -> float | None:
    try:
        above, _, below = token.partition("/")
        return float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        return None
