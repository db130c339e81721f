"""Words, numbers and marks of a sentence, in one spelling."""

from __future__ import annotations

import re
import unicodedata

SPELLINGS = (
    (r"[\u2018\u2019`]", "'"),
    (r"^(could|would|ca|can|wo|should)n'?t (you|we|it|this|that|the)\b", r"\1 \2"),
    (r"\blet's\b", "let us"),
    (r"\b(it'?s|is|are|looks|way|far) to (?=\w+\W*$)", r"\1 too "),
    (r"\b(?:at )?(?:half|quarter) past \w+\b|\b(?:at )?\w+ o'?clock\b", ""),
    (r"colou?r", "color"),
    (r"\bbring (the \w+) out\b", r"bring out \1"),
    (r"(?<=\w)-ish\b", "ish"),
    (r"\bde-(?=[a-z])", "de"),
    (r"\bun-(?=[a-z])", "not "),
    (r"\b(?!feel|for)(\w+)[- ]free\b(?! (?:of|to|from))|\b(shadow|snow|fog)less\b", r"no \1\2"),
    (r"\bless than (?=\d|half|an? )", ""),
    (r"\bminus (?=\d)", "-"),
    (r"\bplus (?=\d)", "+"),
    (r"\b(can)not\b", r"\1 not"),
    (
        r"\b(do|does|did|is|are|was|were|ca|wo|should|could|would|must|has|have|need)n'?t\b",
        r"\1 not",
    ),
    (r"\bca not\b", "can not"),
    (r"\b(it|that|what|there|he|she|everything)'s\b|\b(its)(?= too\b)", r"\1\2 is"),
    (r"(?<=s)'(?=\s)", " 's "),
    (r"'d\b", " would"),
    (r"'(ll|m|re|ve)\b", ""),
    (r"\bgrey", "gray"),
    (r"\bfibre\b", "fiber"),
    (r"\bpercents?\b|\bper cent\b|\bpct\b", "%"),
    (r"(?<=\d)\.(?=\D|$)", " . "),
    (r"(?<=\w)\s+-\s+(?=\w)|->|=>|=|--+|[\u2014\u2013]", " : "),
    (r"(?<=[a-z])-(?=[a-z])", " "),
    (r"\+(?!\d)", " and "),
    (
        r"(?:\b(?:in |with )?(?:the |a )?(?:style|manner|look)s? of |(?<!i )(?<!not )\blike )"
        r"(?:this|that|my|the attached|the given)(?: other)? "
        r"(?:picture|photo|photograph|image|painting|drawing)\b",
        "like the given picture",
    ),
    (r"\b(lighter|darker|paler|deeper|brighter) (?:shade|tone|version) of\b", r"\1"),
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
