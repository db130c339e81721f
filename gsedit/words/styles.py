"""Painting styles that a sentence asks for. Loads no torch."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.errors import UsageError
from gsedit.words import lexicon
from gsedit.words.lexicon import rows_of


@dataclass(frozen=True)
class Style:
    """A style of the painter."""

    name: str
    number: int


STYLES = {
    name: Style(name, int(number))
    for name, _, number in (value.rpartition(" ") for _, value, _ in rows_of(lexicon.STYLES))
}


def style_asked(sentence: str) -> Style:
    """The style that a sentence asks for. Raises UsageError where it asks for none."""
    for name in STYLES:
        if sentence.strip().endswith(name):
            return STYLES[name]
    raise UsageError(f"{sentence!r} asks for no style")
