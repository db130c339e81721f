"""Colors by name and number: the xkcd survey, CSS, `#rrggbb`, `rgb(...)`, and modifiers in Lab."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from gsedit.errors import UsageError
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex, srgb_of_lab
from gsedit.words.lexicon import shades, things

TABLE = Path(__file__).with_name("colors.txt")
LONGEST = 4
"""Most words of a color's name."""
WEATHER = frozenset(("snow", "desert", "bland", "metallic blue"))
"""Names of a color that mean another thing in a sentence."""
ISH = re.compile(r"^(\w+?)(d?d?ish|y)$")
ROOTS = {"blu": "blue", "whit": "white", "purpl": "purple", "orang": "orange", "re": "red"}
THINGS = frozenset(("sky", "grass", "leaf", "sea", "dirt", "sand", "stone", "brick"))
"""Names of a color that another color may be said of: "paint the sky purple"."""
PLAIN = frozenset(things("plain"))
"""Names of color that all others are said by."""


@lru_cache(1)
def colors() -> dict[str, str]:
    """Hex colors, as "#rrggbb", by lower-case names: 949 of xkcd, those of CSS, and some
    that neither has."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    table = dict(line.rsplit(" ", 1) for line in lines if not line.startswith("# "))
    spaced = {name.replace("/", " "): value for name, value in table.items()}
    return {name: value for name, value in spaced.items() if name not in WEATHER}


def named(name: str) -> str | None:
    """Hex color of a name, in either spelling of gray; None if no list has it."""
    table = colors()
    return table.get(name) or table.get(name.replace("gray", "grey"))


def hexadecimal(text: str) -> str | None:
    """Color "#rrggbb" of `#rgb`, `#rrggbb`, `rgb(r, g, b)` with 0 to 255; None for other text."""
    if match := re.fullmatch(r"#([0-9a-f]{6}|[0-9a-f]{3})", text):
        digits = match[1]
        return "#" + (digits if len(digits) == 6 else "".join(each * 2 for each in digits))
    if match := re.fullmatch(r"rgb\s*\(?\s*(\d+)[\s,]+(\d+)[\s,]+(\d+)\s*\)?", text):
        values = [int(each) for each in match.groups()]
        return "#{:02x}{:02x}{:02x}".format(*values) if max(values) < 256 else None
    return None


def parse_hex(text: str | None) -> Float64[np.ndarray, "3"]:
    """The display color in [0, 1] of "#rrggbb". Raises UsageError for another text."""
    if text is None or not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise UsageError(f"color {text}: give six hexadecimal digits, as in #008080")
    return srgb_of_hex(text)


def modified(color: str, modifier: str, times: float = 1.0) -> str:
    """Color that a word of `lexicon.shades` makes of another, in Lab."""
    step, chroma = shades()[modifier]
    lab = lab_of(color)
    lab = np.array([np.clip(lab[0] + times * step, 3, 98), *(lab[1:] * chroma**times)])
    return _hex(lab)


def between(first: str, second: str) -> str:
    """Color midway between two, in Lab."""
    return _hex((lab_of(first) + lab_of(second)) / 2)


def distance(first: str, second: str) -> float:
    """CIE 1976 difference of two colors."""
    return float(np.linalg.norm(lab_of(first) - lab_of(second)))


def lab_of(color: str) -> np.ndarray:
    """CIE Lab of "#rrggbb"."""
    return lab_of_srgb(srgb_of_hex(color))


def _hex(lab: np.ndarray) -> str:
    levels = np.clip(np.rint(srgb_of_lab(lab) * 255), 0, 255).astype(int)
    return "#{:02x}{:02x}{:02x}".format(*levels)


def longest(words: list[str]) -> tuple[int, str] | None:
    """(words used, color) of the longest color that a list of words begins with."""
    for count in range(min(LONGEST, len(words)), 0, -1):
        if color := named(" ".join(words[:count])):
            after = words[count : count + 1]
            doubled = bool(after) and after[0] in PLAIN and words[count - 1] not in THINGS
            plain = named(after[0]) if doubled else None
            # "apple red" is red, "salmon pink" still salmon
            return count + doubled, plain if plain and distance(color, plain) > 60.0 else color
    word = words[0]
    if word in shades() and len(words) > 1:
        rest = longest(words[1:])
        return rest and (1 + rest[0], modified(rest[1], word))
    if (root := _root(word)) and len(words) > 1 and (rest := longest(words[1:])):
        return 1 + rest[0], between(between(root, rest[1]), rest[1])
    return None


def _root(word: str) -> str | None:
    """Color of "bluish", "greeny"."""
    match = ISH.match(word)
    return match and named(ROOTS.get(match[1], match[1]))
