"""Words of a sentence in one spelling, and the clauses between its marks."""

from __future__ import annotations

import re
import unicodedata

SPELLINGS = (
    (r"[\u2018\u2019`]", "'"),
    (r"\bcolou?r(ed|s)?\b(?!\w)", r"color\1"),
    (r"\bcolou?r(ing|ful|less|fulness)\b", r"color\1"),
    (r"\bcolored\b", "color"),
    (r"\bcolorized?\b", "color"),
    (r"\b(can|wo)n't\b|\bcannot\b", "not"),
    (r"\b(do|does|is|are|was|should|must|did|has)n'?t\b", "not"),
    (r"\bdont\b|\bdo not\b", "not"),
    (r"\bnever\b", "not"),
    (r"\b(it|that|what|there|he|she)'s\b", r"\1 is"),
    (r"'s\b", ""),
    (r"\bwater ?colou?rs?\b", "watercolor"),
    (r"\bcentre\b", "center"),
    (r"\bfavour\b", "favor"),
    (r"(?<=\w)['](?=\w)", ""),
    (r"\bgrey\b", "gray"),
    (r"\baluminium\b", "aluminum"),
    (r"\bcarbon fibre\b", "carbon fiber"),
    (r"\bpercents?\b|\bper cent\b|\bpct\b", "%"),
    (r"\bre-?paint\b", "paint"),
    (r"\bmy eyes(?: hurt| ache| are hurting)?\b", ""),
    (r"\bblack\s*(?:and|n|&|/|\+|-|'n')\s*white\b|\bb\s*(?:&|/|and|n)\s*w\b", "grayscale"),
    (r"\bturn(?:ed|ing)? (it |that |things |the \w+ )?down\b", r"turndown \1"),
    (r"\bturn(?:ed|ing)? (it |that |things |the \w+ )?up\b", r"turnup \1"),
    (r"\bblow(?:n)?[- ]out\b", "blown out"),
    (r"\bnegative (image|photo|film)\b", "negative"),
    (
        r"\b(?:drain|take|suck|remove|strip|without|no|lose|kill|zero|drop)(?: (?:all|"
        r"any|the|of|out|its|more))* (?:colors?|saturation)\b(?! (?:cast|tint|by|change|"
        r"a ))(?: (?:out|away))?",
        "grayscale",
    ),
    (
        r"\bdesaturate (it |everything |the \w+ )?(completely|fully|entirely|totally)\b|"
        r"\b(?:completely|fully|totally) desaturate(?:d)?\b",
        r"grayscale \1",
    ),
)
"""Patterns and what stands in their place, in order."""
MARKS = re.compile(
    r"[;.!?:\n,]+|\b(?:and then|and also|and|then|but|while|whereas|plus|however|"
    r"afterwards|although)\b|[&|]|--+|\u2014|(?<=\s)-(?=\s)"
)
WORD = re.compile(r"<\w+>|#[0-9a-f]{3,6}\b|[+-]?\d+(?:\.\d+)?|%|[a-z]+|\+")


def normalised(sentence: str) -> str:
    """Lower-case ASCII text of a sentence in one spelling."""
    text = unicodedata.normalize("NFKC", sentence).lower()
    text = text.replace("->", ": ").replace("=>", ": ").replace("=", " ").replace("_", " ")
    for pattern, put in SPELLINGS:
        text = re.sub(pattern, put, text)
    text = "".join(each for each in unicodedata.normalize("NFD", text) if each.isascii())
    return re.sub(r"\s+", " ", text).strip()


def clauses(text: str) -> list[str]:
    """Parts of a text between its marks and conjunctions; a decimal point is none."""
    parts = MARKS.split(re.sub(r"(\d)\.(\d)", r"\1\\\2", text))
    return [part.replace("\\", ".").strip() for part in parts if part.strip(" '\"()[]-")]


def words(text: str) -> list[str]:
    """Words, numbers, "%" and "#rrggbb" of a text."""
    return WORD.findall(text.replace("-", " ") if not re.search(r"-\s?\d", text) else text)
