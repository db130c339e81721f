"""Painting styles that a sentence asks for. Loads no torch."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.errors import UsageError


@dataclass(frozen=True)
class Style:
    """A style of the painter."""

    name: str
    number: int


STYLES = {f"style {number}": Style(f"style {number}", number) for number in range(26)}


def style_asked(sentence: str) -> Style:
    """The style that a sentence asks for. Raises UsageError where it asks for none."""
    for name in STYLES:
        if sentence.strip().endswith(name):
            return STYLES[name]
    raise UsageError(f"{sentence!r} asks for no style")
