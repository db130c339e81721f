"""Actions on objects, with their numbers: what removes, scales, turns, moves, copies or puts in.

Loads no torch.
"""

from __future__ import annotations

import re

from gsedit.words.amounts import number_of
from gsedit.words.instruction import Change, Place, Side
from gsedit.words.lexicon import pattern, spans, things
from gsedit.words.marks.marked import Asked
from gsedit.words.phrases import IT
from gsedit.words.refusals import Refused
from gsedit.words.scan import scanned

STEP = {"": 1.0, "little": 0.5, "much": 2.0}
"""Powers of `LARGER` for a size without a number."""
LARGER = 1.3
FAR = {"": None, "little": 0.25, "much": 1.0}
"""Shares of its size that an object moves without a number."""
SIZES = (0.1, 10.0)
"""Factors that an object is scaled by."""
MOST_COPIES = 20
METRES = {unit: float(metres) for unit, metres in things("metres").items()}
UNIT = re.compile(rf"(?<![a-z])({spans('metres')})\b")
LENGTH = re.compile(rf"\S+ ?{UNIT.pattern}")
TURNS: dict[str, float] = {"quarter": 90.0, "half": 180.0, "full": 360.0}
"""Degrees of a part of a turn."""
CLOCKWISE = pattern("clockwise")
"""The way of a turn, and what turns it around."""
WHERE: dict[str, Side] = things("where")  # type: ignore[assignment]
"""The side of each way of the network."""
SIDE_OF: dict[str, Side] = {"forward": "front", "back": "behind", "up": "on", "down": "on"}
"""Side of something for a way to go."""
LED = re.compile(rf"^(?:.*?\b(?:{spans('before')}))\s+(.+)$", re.IGNORECASE | re.DOTALL)
"""A place that ends with the phrase of what it is a side of."""
SIDE_OF_IT = re.compile(r".*\b(?:left|right|front|back|rear|top|side) of (.+)$", re.IGNORECASE)
"""A place that says on which side of something it is."""
UNREAL = re.compile(rf"^(?:the |its |his |her |their |all |any )*(?:{spans('unreal')})\b")
"""Phrases of what is no object."""


def action(asked: Asked, text: str, phrase: str) -> Change:
    """The change of an object that is asked for, of what a phrase names. Raises Refused."""
    if asked.deed != "turn" and UNREAL.match(asked.of):
        raise Refused("unreal")
    make = {"scale": _scale, "turn": _turn, "move": _move, "copy": _copy}.get(asked.deed)
    amount, place = make(asked, text, phrase) if make else (None, None)
    return Change("subject", "object", asked.deed, None, amount, "object", phrase, place)


def _scale(asked: Asked, text: str, phrase: str) -> tuple[float, None]:
    factor = _factor(asked, text.lower())
    if factor is None or factor == 1:
        factor = LARGER ** ((asked.sign or 1) * STEP[asked.degree])
    if not SIZES[0] <= factor <= SIZES[1]:
        raise Refused("size")
    return round(factor - 1, 4), None


def _factor(asked: Asked, text: str) -> float | None:
    """Factor of size by an amount: 1.2 for "20 % larger", 0.5 for "to half"; None for none."""
    number, sign, said = number_of(scanned(asked.amount)), asked.sign or 1, asked.amount
    if ratio := re.search(r"(\d+) ?: ?([1-9]\d*)", said):
        return float(ratio[1]) / float(ratio[2])
    if number is None or number < 0:
        return None
    remains = said.startswith(("to ", "at ")) and asked.after.lower() not in ("less", "off")
    remains = remains or asked.after.lower() in ("of", "as", "the", "its")
    remains = remains and not (sign > 0 and number < 100 and re.search(r"\bas (?:it|they)\b", text))
    if "%" in said or "percent" in said or "per cent" in said:
        share = number / 100
        more = said.startswith("by") or asked.after.lower().endswith("er")
        whole = remains or (share > 1 and not more)
        return share if whole else 1 + sign * share
    if re.search(r"half(?: as \w+)? again", text):
        return 1.5
    if remains:
        return 1 / number if number > 1 and re.search(r"\bas (?:small|short)", text) else number
    near = re.search(rf"\bby (?:like|about|maybe|say|around) {re.escape(said)}", text)
    if number < 1 and ("." in said or "/" in said) and not (near or said.startswith("by ")):
        return number
    if number < 1:
        told = asked.after.lower().endswith(("er", "again", "off", "less"))
        added = told or near or said.startswith("by") or sign > 0
        return 1 + sign * number if added else number
    return 1 / number if sign < 0 else number


def _turn(asked: Asked, text: str, phrase: str) -> tuple[float, None]:
    number, said = number_of(scanned(asked.amount)), asked.amount
    part = next((degrees for name, degrees in TURNS.items() if name in said), None)
    if part is not None:
        degrees = part * (3 if "three" in said else 1)
    elif number is not None:
        degrees = number * 360 if number < 1 else number
    elif asked.degree == "little":
        degrees = 15.0
    else:
        degrees = 90.0 if asked.sign and not re.search(r"\b(?:around|other way)\b", text) else 180
    if not degrees % 360:
        raise Refused("nonsense")
    ways = {each.lastindex is None for each in CLOCKWISE.finditer(text)}
    ways = set() if re.search(r" (?:left|right)\b", text) else ways
    sign = -1 if ways == {True} or (ways != {False} and asked.sign < 0) else 1
    return round(sign * (degrees % 360) / 360, 6), None


def _copy(asked: Asked, text: str, phrase: str) -> tuple[float | None, Place]:
    count = max(1, int(number_of(scanned(LENGTH.sub("", asked.amount))) or 1))
    count -= asked.amount in ("double", "triple")  # the thing itself is one of them
    if count > MOST_COPIES:
        raise Refused("copies")
    side, of = place_of(asked)
    side = SIDE_OF.get(side, side) if side else "beside"
    return (float(count) if count > 1 else None), Place(side, of or phrase)


def _move(asked: Asked, text: str, phrase: str) -> tuple[float | None, Place]:
    side, of = place_of(asked)
    if side is None:
        raise Refused("direction")
    if of:
        return None, Place(side, of)
    side = {"front": "forward", "behind": "back"}.get(side, side)
    if side in ("on", "beside"):
        side = "up" if side == "on" else "left"
    far, units, metres = _distance(asked)
    return far, Place(side, "", units, metres)  # type: ignore[arg-type]


def _distance(asked: Asked) -> tuple[float | None, bool, bool]:
    """(how far, whether in units of the scene, whether in metres)."""
    number, said = number_of(scanned(asked.amount)), asked.amount
    if number is None:
        return FAR[asked.degree], False, False
    if unit := UNIT.search(said):
        return number * METRES[unit[1]], False, True
    if "unit" in said or asked.after.lower().startswith("unit"):
        return number, True, False
    return (number / 100 if "%" in said else number), False, False


def place_of(asked: Asked) -> tuple[Side | None, str]:
    """(side or way, phrase of what it is a side of) of a place; "" for a way to go."""
    from gsedit.words.marks.marked import phrase

    side = WHERE.get(asked.way)
    near = side in ("left", "right", "front", "behind", "on", "beside")
    led = (SIDE_OF_IT.match(asked.to) or LED.match(asked.to)) if near else None
    own = led and asked.way in ("left", "right") and " of " not in f" {asked.to} "
    if side is None or led is None or own:
        return side, ""
    of = phrase(led[1])
    return side, IT if of in things("same") else of


def inserted(file: str, asked: Asked) -> Change:
    """The scene of a file put at a place; where the cameras look if none is said."""
    side, of = place_of(asked)
    place = Place(SIDE_OF.get(side, side), of or IT) if side else None
    return Change("scene", "object", "insert", None, None, "object", file, place)
