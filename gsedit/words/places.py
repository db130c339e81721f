"""Places and distances that a clause about an object names. Loads no torch."""

from __future__ import annotations

import re

from gsedit.words.instruction import Place, Side
from gsedit.words.phrases import object_phrase
from gsedit.words.refusals import Refused
from gsedit.words.scan import scanned

NUMBER = r"[+-]?\d+(?:\.\d+)?|half|one|two|three|four|five|ten|twice|a third|a quarter"
LENGTH = "heights?|widths?|sizes?|lengths?|breadths?"
METRES = "mm|cm|m|centimeters?|meters?|metres?|centimetres?|inch|inches|foot|feet|pixels?|px"
DISTANCE = (
    rf"(?:(?:{NUMBER}) ?)?(?:times )?(?:of )?(?:a |its |his |her |their )?(?:own )?(?:{LENGTH})"
    rf"|(?:{NUMBER}) %(?: of its (?:own )?(?:{LENGTH}))?|(?:{NUMBER})(?: (?:units?|{METRES}))?"
    r"|a (?:little )?bit|a little|slightly|a touch|a tad|somewhat|a lot|far|much"
)
"""Pattern of a distance."""
MILD, STRONG = 0.25, 1.0
"""Shares of its size that an object moves "a bit" and "a lot"."""
WAYS: dict[Side, str] = {
    "left": r"(?:(?:to|on|towards?) )?(?:(?:the|its|his|her) )?left(?: side)?|leftwards?",
    "right": r"(?:(?:to|on|towards?) )?(?:(?:the|its|his|her) )?right(?: side)?|rightwards?",
    "forward": r"forwards?|closer|nearer|in front|to the front"
    r"|(?:(?:closer|nearer) )?(?:to|towards?) (?:me|us|the (?:camera|viewer|front))",
    "back": r"back|backwards?|farther|further|(?:farther |further )?(?:away|back|off)|to the back"
    r"|behind|away from (?:me|us|the camera)",
    "up": r"up|upwards?|higher(?: up)?",
    "down": r"down|downwards?|lower(?: down)?",
    "on": "on top",
    "beside": "beside|next to|alongside|to the side",
}  # fmt: skip
"""Ways to go, and sides without what they are of."""
SIDES: dict[Side, str] = {
    "left": r"(?:(?:to|on|at) the )?left(?: side)? of",
    "right": r"(?:(?:to|on|at) the )?right(?: side)? of",
    "front": "in front of|before",
    "behind": "behind",
    "on": r"(?:to|in|into|at|on) the (?:center|centre|middle|top) of|on top of|onto|on to|upon|on",
    "beside": "next to|beside|near|by|alongside|closer to|close to|nearer to|at the side of",
}  # fmt: skip
SIDED: dict[Side, Side] = {"forward": "front", "back": "behind", "up": "on"}
"""Side of a thing that a way leads to."""


def place_of(text: str) -> Place | None:
    """The place that words name: a way to go, or a side of an object; None for no place."""
    for side, pattern in WAYS.items():
        if re.fullmatch(pattern, text) and side not in ("on", "beside"):
            return Place(side)
    for side, pattern in SIDES.items():
        match = re.fullmatch(rf"(?:{pattern}) (.+)", text)
        if match and (phrase := object_phrase(_spelled(match[1]))):
            return Place(side, phrase)
    return None


def side_of(text: str, phrase: str) -> Place | None:
    """The side of something that words name, by default of what the phrase names."""
    if place := place_of(text):
        side = SIDED.get(place.side, place.side)
        return None if side == "down" else Place(side, place.of or phrase)
    bare: tuple[Side, ...] = ("on", "beside")
    return next((Place(side, phrase) for side in bare if re.fullmatch(WAYS[side], text)), None)


def _spelled(text: str) -> str:
    """The phrase of a thing that a place is of: "the first" is what was there."""
    return "it" if text in ("the first", "the first one", "the original") else text


def distance_of(text: str) -> tuple[float | None, bool]:
    """(distance, whether in units of the scene) of words; (None, False) for none.

    Raises Refused for a distance in metres: a scene does not know its scale.
    """
    if not text:
        return None, False
    if re.search(rf"\b(?:{METRES})$", text):
        raise Refused("distance")
    words = scanned(text)
    kinds = {word.kind for word in words}
    if "slight" in kinds or "strong" in kinds:
        return (MILD if "slight" in kinds else STRONG), False
    sized = re.search(rf"(?:%|{LENGTH})", text)
    number = next((w.number for w in words if w.kind in ("number", "fraction", "factor")), 1.0)
    return number / (100 if "%" in text else 1), not sized
