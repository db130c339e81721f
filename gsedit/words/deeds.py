"""One clause about an object as a change: remove, scale, turn, move, copy, insert; and about what
lies or grows on things. Loads no torch.

Its patterns, in deeds.txt, are of a whole clause as `gsedit.words.scan` spells it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

from gsedit.words.amounts import amount_of
from gsedit.words.instruction import Change, Place, Side
from gsedit.words.lexicon import things
from gsedit.words.phrases import IT, object_phrase
from gsedit.words.refusals import Refused
from gsedit.words.scan import scanned
from gsedit.words.slots import acted

NEAR, FAR = 0.25, 1.0
"""Shares of its size that an object moves "a bit" and "a lot"."""
SIDED: dict[Side, Side] = {"forward": "front", "back": "behind", "up": "on"}
"""Side of a thing that a way leads to."""
BARE: tuple[Side, ...] = ("on", "beside")
"""Sides that are said without what they are of."""
FIRST = ("the first", "the first one", "the original")
"""Phrases beside a copy of what was there before."""
TABLE = Path(__file__).with_name("deeds.txt")
ROWS = [
    (head, text)
    for head, mark, text in (line.partition(": ") for line in TABLE.read_text().splitlines())
    if mark and not head.startswith("#")
]
"""Patterns of whole clauses by the deed that they ask for, and parts of them, in order."""
HOLES = {kind.upper(): "|".join(things(kind)) for kind in ("growth", "withered", "thickness")}
"""Patterns that stand in others, by their names in braces."""
for _head, _text in ROWS:
    if _head.startswith("hole "):
        HOLES[_head.removeprefix("hole ")] = _text.format_map(HOLES)
WAYS: dict[Side, str] = {cast("Side", head[4:]): text for head, text in ROWS if head[:4] == "way "}
SIDES: dict[Side, str] = {
    cast("Side", head[5:]): text for head, text in ROWS if head[:5] == "side "
}
"""Ways to go, and sides of something."""
LARGER, SMALLER = 1.3, 1 / 1.3
"""Factors of "bigger" and "smaller" without a number: plainly seen."""
MILD, STRONG = 0.5, 2.0
"""Powers of these factors that "a bit" and "much" make."""
SIZES = (0.1, 10.0)
"""Least and largest factor of size that a sentence may ask for: beyond is a slip of the pen."""

Said = dict[str, str]
"""Text by hole, and by group of a pattern; "" where nothing is said."""


def change_of(clause: str) -> Change | None:
    """The change of an object that a clause asks for; None where not all of its words say one.

    Raises Refused for an amount that cannot be done.
    """
    for pattern, make in PATTERNS:
        if match := pattern.fullmatch(SINCE.sub("", clause) if make is _grown else clause):
            said = {name: text or "" for name, text in match.groupdict().items()}
            if change := make(said):
                return change
    return acted(clause)


def _changed(name: str, said: Said, amount: float | None = None) -> Change | None:
    """The change of what X names, the subject where it is left out; None where it is no object."""
    phrase = object_phrase(said.get("x") or IT)
    return Change("subject", "object", name, None, amount, "object", phrase) if phrase else None


def _removed(said: Said) -> Change | None:
    return _changed("remove", said)


def _unwanted(said: Said) -> Change | None:
    """A removal of what nobody wants there; None for what must only not be done with it there."""
    *words, last = scanned(said["x"])
    done = last.text.endswith(("ed", "ing", "en", "wn"))  # "the bear moved here"
    named = any(word.kind in ("subject", "unknown") for word in words)
    return None if done or named else _removed(said)


def _isolated(said: Said) -> Change | None:
    """All but an object removed: "remove everything but the bear"."""
    phrase = object_phrase(said.get("x") or IT)
    if phrase is None:
        return None
    return Change("background", "object", "remove", None, None, "object", phrase)


def _scaled(said: Said) -> Change | None:
    """A change of size by a word, a factor or a share: "a third bigger"."""
    word = said.get("more", "")
    up = bool(re.fullmatch(r"bigger|larger|up|enlarge|magnify|increase|small|tiny", word))
    return _sized(said, _factor(said.get("much") or said.get("by", ""), up if word else None))


def _of_old(said: Said) -> Change | None:
    """A size in shares of the one now: "half as big"."""
    if not said.get("more"):
        return _sized(said, _factor(said["much"], None, of_old=True))
    return _sized(said, {"double": 2.0, "triple": 3.0, "halve": 0.5}[said["more"]])


def _sized(said: Said, factor: float | None) -> Change | None:
    change = _changed("scale", said)
    if change is None or factor is None:
        return None
    if not SIZES[0] <= factor <= SIZES[1]:
        raise Refused("size")
    return _changed("scale", said, round(factor - 1, 4))


def _factor(much: str, larger: bool | None, *, of_old: bool = False) -> float | None:
    """Factor of size of an amount in words; None where they are no amount."""
    words = scanned(much)
    kinds = {word.kind for word in words}
    if kinds <= {"slight", "strong", "fill"}:
        step = MILD if "slight" in kinds else STRONG if "strong" in kinds else 1.0
        return None if larger is None else (LARGER if larger else SMALLER) ** step
    if not kinds <= {"number", "unit", "factor", "fraction", "fill"}:
        return None
    given = amount_of(scanned(f"{much} as" if of_old else f"by {much}"))
    factor, share = given.factor, given.share
    if len(words) == 1 and words[0].kind == "number":  # "by 2"
        factor, share = words[0].number, None
    if share is not None:
        factor = share if larger is None else 1 + share if larger else 1 - share
    if factor is None or factor <= 0:
        return None
    return 1 / factor if larger is False and factor > 1 else factor


def _turned(said: Said) -> Change | None:
    """A turn about up, as a share of the full circle; half of it where no angle is said."""
    words = scanned(said.get("much", ""))
    if any(word.kind != "number" and word.value != "degrees" for word in words):
        return None
    degrees = sum(word.number for word in words) if words else 180.0
    degrees = {"quarter": 90.0, "half": 180.0, "three quarter": 270.0}.get(
        said.get("part", ""), degrees
    )
    way = said.get("way", "")
    share = (-degrees if way == "clockwise" or way.endswith("right") else degrees) / 360
    return _changed("turn", said, round(share, 6)) if share % 1 else None


def _moved(said: Said) -> Change | None:
    """A move in a direction, or to a side of something."""
    lift, change = said.get("lift"), _changed("move", said)
    place = place_of(said["at"]) if not lift else Place("down" if lift == "lower" else "up")
    if not change or not place:
        return None
    upright = place.side in ("up", "down", "back") and not said.get("verb")
    if upright and (not lift or change.phrase == IT):
        return None  # "bring it down", "raise it" are said of tones
    amount, units = distance_of(said.get("far", ""))
    if amount is None and units:
        return None  # in metres
    if amount is not None and place.of:
        return None  # "20 % next to the chair"
    place = Place(place.side, place.of, units)
    return Change("subject", "object", "move", None, amount, "object", change.phrase, place)


def _copied(said: Said) -> Change | None:
    """Another one of something, at a place or beside it."""
    x = said.get("x", "")
    x = IT if x in ("", "one") else x
    phrase = object_phrase(x)
    if phrase in (None, x) and x != IT and not re.match(HOLES["OWNS"], x):
        phrase = object_phrase(f"the {x}")
    place = phrase and side_of(said.get("at") or "beside", phrase)
    if not phrase or not place:
        return None
    return Change("subject", "object", "copy", None, None, "object", phrase, place)


def _inserted(said: Said) -> Change | None:
    """The scene of a file, at a place; where the cameras look if none is said."""
    place = side_of(said["at"], IT) if said["at"] else None
    if said["at"] and place is None:
        return None
    return Change("scene", "object", "insert", None, None, "object", said["file"], place)


# ---- places and distances -----------------------------------------------------------------------


def place_of(text: str) -> Place | None:
    """The place that words name: a way to go, or a side of an object; None for no place."""
    for side, pattern in WAYS.items():
        if re.fullmatch(pattern, text) and side not in BARE:
            return Place(side)
    for side, pattern in SIDES.items():
        match = re.fullmatch(rf"(?:{pattern}) (.+)", text)
        of = match and ("it" if match[1] in FIRST else match[1])
        if of and (phrase := object_phrase(of)):
            return Place(side, phrase)
    return None


def side_of(text: str, phrase: str) -> Place | None:
    """The side of something that words name, by default of what the phrase names."""
    if place := place_of(text):
        side = SIDED.get(place.side, place.side)
        return None if side == "down" else Place(side, place.of or phrase)
    return next((Place(side, phrase) for side in BARE if re.fullmatch(WAYS[side], text)), None)


def distance_of(text: str) -> tuple[float | None, bool]:
    """(distance, whether in units of the scene) of words; (None, False) for none.

    Raises Refused for a distance in metres: a scene does not know its scale.
    """
    if not text:
        return None, False
    if re.search(rf"\b(?:{HOLES['METRES']})$", text):
        return None, True
    words = scanned(text)
    kinds = {word.kind for word in words}
    if "slight" in kinds or "strong" in kinds:
        return (NEAR if "slight" in kinds else FAR), False
    sized = re.search(rf"(?:%|{HOLES['LENGTH']})", text)
    number = next((w.number for w in words if w.kind in ("number", "fraction", "factor")), 1.0)
    return number / (100 if "%" in text else 1), not sized


# ---- layers: "make it snow" is weather and "cover it in moss" a material ------------------------

SINCE = re.compile(r" after (?:the |some |heavy )*(?:rain|storm|shower|snowfall)$")
"""Words that only say why something lies there."""
THINNEST = 0.9
"""Largest share by which a layer is made thinner: no layer at all is no change."""
EVERYWHERE = ("everything", "the scene", "the whole scene", "all of it")


def _grown(said: Said) -> Change | None:
    """A layer of something on an object, or on all that there is."""
    amount = _thickness(said["thick"]) if said.get("thick") else None
    where, name = said.get("x"), said["what"]
    if not where or where in EVERYWHERE:
        return Change("scene", "growth", name, None, amount, "object")
    phrase = object_phrase(where, parts=True)
    return Change("subject", "growth", name, None, amount, "object", phrase) if phrase else None


def _thickness(thick: str) -> float:
    """The share that a layer is thicker than usual, by a word or a number of percent."""
    if number := re.match(r"[0-9.]+", thick):
        share = float(number[0]) / 100
        return -min(share, THINNEST) if thick.endswith("thinner") else share
    return float(things("thickness")[thick])


def _emptied(said: Said) -> Change:
    """All that there is removed: only where something is left out of it."""
    return Change("scene", "object", "remove", None, None, "object", "")


MAKERS: dict[str, Callable[[Said], Change | None]] = {
    "isolate": _isolated, "all": _emptied, "remove": _removed, "unwanted": _unwanted,
    "scale": _scaled, "resize": _of_old, "turn": _turned, "move": _moved, "insert": _inserted,
    "copy": _copied, "grow": _grown,
}  # fmt: skip
"""Who makes a change of what a pattern finds, by the deed of its row."""
PATTERNS = [
    (re.compile(text.replace("{ITS}", its).format_map(HOLES)), MAKERS[head])
    for head, text in ROWS
    if head in MAKERS
    for its in ([each for kind, each in ROWS if kind == "its"] if "{ITS}" in text else [""])
]
