"""An action on an object by its parts, in any order: a verb, a thing, an amount, a way or a place.

What is left of a clause must be words that say nothing. Loads no torch.
"""

from __future__ import annotations

import re

from gsedit.words.instruction import Change, Place, Side
from gsedit.words.lexicon import SLOTS, rows_of, things
from gsedit.words.phrases import IT
from gsedit.words.refusals import Refused
from gsedit.words.scan import STAND_IN, scanned

TABLE = {
    (kind, value): "|".join(sorted(map(re.escape, phrases), key=len, reverse=True))
    for kind, value, phrases in rows_of(SLOTS)
}
"""Alternatives of words by kind and value."""
NUMBERS = {
    "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0, "six": 6.0, "seven": 7.0,
    "eight": 8.0, "nine": 9.0, "ten": 10.0, "twelve": 12.0, "fifteen": 15.0, "twenty": 20.0,
    "thirty": 30.0, "forty": 40.0, "forty five": 45.0, "fifty": 50.0, "sixty": 60.0,
    "seventy": 70.0, "eighty": 80.0, "ninety": 90.0, "hundred": 100.0, "a hundred": 100.0,
    "a": 1.0, "an": 1.0, "half": 0.5, "half a": 0.5, "half an": 0.5, "one and a half": 1.5,
    "two and a half": 2.5, "a couple of": 2.0, "a few": 3.0, "some": 3.0, "several": 3.0,
    "both": 2.0, "a third of": 1 / 3, "half of": 0.5, "a quarter of": 0.25,
    "one time and a half": 1.5,
}  # fmt: skip
NUMBER = (
    rf"(?P<n>[+-]?\d+(?:\.\d+)?(?:/\d+)?|"
    rf"{'|'.join(sorted(map(re.escape, NUMBERS), key=len, reverse=True))})"
)
METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0, "inch": 0.0254, "foot": 0.3048, "yard": 0.9144}
"""Metres of a unit of length."""
THING = re.compile(rf"\bthe ({STAND_IN})\b")
PRONOUN = re.compile(r"\b(?:it|him|her|them|this|that|these|those)\b")


class Clause:
    """Text of a clause, from which what is read is taken out."""

    def __init__(self, text: str) -> None:
        """Begin with all of it."""
        self.text = f" {text} "

    def take(self, pattern: str) -> re.Match[str] | None:
        """The match of a pattern, which is then out of the text."""
        match = re.search(rf"(?<= )(?:{pattern})(?= )", self.text)
        if match:
            self.text = f"{self.text[: match.start()]} {self.text[match.end() :]}"
            self.text = re.sub(r" +", " ", self.text)
        return match

    def word(self, kind: str, value: str = "") -> bool:
        """Whether it has one of the words of a row."""
        return bool(self.take(TABLE[kind, value]))

    def one_of(self, kind: str) -> str:
        """Value of the first row of a kind of which it has a word; "" for none."""
        return next((v for k, v in TABLE if k == kind and self.word(k, v)), "")

    @property
    def is_empty(self) -> bool:
        """Whether only words are left that say nothing."""
        idle = ("fill", "be", "wish", "do", "mark", "degree", "conj", "slight", "up", "enough")
        words = scanned(self.text)
        return all(
            (word.kind in idle or word.text in IDLE) and word.text not in HELD for word in words
        )


HELD = frozenset(("it", "him", "her", "them", "shadow", "shadows", "if", "only", "light", "color"))
"""Words that do say something of it."""
IDLE = frozenset(things("filler")) | frozenset(things("idle"))
"""Words that say nothing of an action."""


def acted(text: str) -> Change | None:
    """The change of an object that a clause asks for; None where its words say more or less.

    Raises Refused for an amount that cannot be done.
    """
    if any(
        word.text == "if" or word.kind in ("not", "keep", "except", "retract", "ask")
        for word in scanned(text)
    ):
        return None
    return next(
        (c for c in (each(Clause(text)) for each in (_copy, _scale, _turn, _move, _remove)) if c),
        None,
    )


def _thing(clause: Clause) -> str | None:
    """The thing of a clause, or "it"; None for none."""
    if match := clause.take(THING.pattern):
        return f"the {match[1]}"
    return IT if clause.take(PRONOUN.pattern) else None


def _object(name: str, phrase: str, amount: float | None, place: Place | None = None) -> Change:
    return Change("subject", "object", name, None, amount, "object", phrase, place)


def _value(text: str) -> float:
    if text in NUMBERS:
        return NUMBERS[text]
    above, _, below = text.partition("/")
    return float(above) / float(below or 1)


def _remove(clause: Clause) -> Change | None:
    phrase = _thing(clause) if clause.word("verb", "remove") else None
    if phrase is None:
        return None
    while clause.take(
        r"(?:away|out|off|from|of|on)(?: (?:the )?(?:zq[a-z][a-z]x|scene|picture|photo|image|"
        r"shot|frame|here|there|view|way))?"
    ):
        pass
    return _object("remove", phrase, None) if clause.is_empty else None


def _scale(clause: Clause) -> Change | None:
    turned = re.search(r" (?:scale|resize|size|bring|take) .*(?:down|up) ", clause.text)
    verb = clause.word("verb", "scale")
    way = clause.one_of("size")
    if not way and turned and verb:
        way = "up" if clause.take("up") else "down" if clause.take("down") else ""
    sized = clause.word("sized")
    clause.word("verb", "make")
    factor = _factor(clause, way, verb or sized)
    if not (verb or way or sized) or factor is None or (phrase := _thing(clause)) is None:
        return None
    if not clause.is_empty:
        return None
    if not 0.1 <= factor <= 10:
        raise Refused("size")
    return _object("scale", phrase, round(factor - 1, 4))


FOLD = {"twice": 2.0, "doubled": 2.0, "double": 2.0, "quadruple": 4.0,
        "tripled": 3.0, "triple": 3.0, "thrice": 3.0}  # fmt: skip
SHARES = {"half": 0.5, "third": 1 / 3, "quarter": 0.25, "fifth": 0.2, "tenth": 0.1}


def _factor(clause: Clause, way: str, sized: bool) -> float | None:
    """Factor of size that a clause says; None for none."""
    if match := clause.take(r"(?:scale )?(?P<a>\d+) : (?P<b>[1-9]\d*)"):
        return float(match["a"]) / float(match["b"])
    if match := clause.take(
        rf"(?:(?P<of>to|at|for) |(?:by|of) )?{NUMBER} %(?P<more> of(?: its| the| their| "
        rf"current| present| original| it)*)?"
    ):
        share = _value(match["n"]) / 100
        if match["of"] or match["more"] or not way:
            return share
        return 1 - share if way == "down" else 1 + share
    if match := clause.take(
        rf"(?:by |to )?(?:a factor of |factor )?{NUMBER} ?(?:times|x|fold|time)"
    ):
        factor = _value(match["n"])
        return 1 / factor if way == "down" and factor > 1 else factor
    if match := clause.take(rf"(?:the )?(?P<n>{'|'.join(FOLD)})"):
        factor = FOLD[match["n"]]
        return 1 / factor if way == "down" else factor
    if match := clause.take(
        rf"(?:by |to |of )?(?P<q>a |the |one |two |three )?(?P<n>{'|'.join(SHARES)})s?(?: of| as)?"
    ):
        share = {"two ": 2, "three ": 3}.get(match["q"] or "", 1) * SHARES[match["n"]]
        if not way or "to " in match[0] or match[0].endswith((" of", " as")):
            return share
        return 1 - share if way == "down" else 1 + share
    if match := clause.take(rf"(?:by |to )?(?:factor )?{NUMBER}"):
        factor = _value(match["n"])
        return factor if sized and match["n"] not in ("a", "an", "one") else None
    if not way:
        return None
    step = 2.0 if clause.word("much") else 0.5 if clause.word("little") else 1.0
    return (1.3 if way == "up" else 1 / 1.3) ** step


def _turn(clause: Clause) -> Change | None:
    verb = clause.word("verb", "turn")
    if match := clause.take(
        rf"(?:by |of |through )?(?:some |about |around )?{NUMBER} ?(?:degrees|degree|deg|\u00b0)"
    ):
        degrees = _value(match["n"])
    elif match := clause.take(
        r"(?:by )?(?:a |one )?(?P<n>quarter|half|three quarters?)(?: of)?(?: a)?(?: turn)?"
    ):
        degrees = {"quarter": 90.0, "half": 180.0}.get(match["n"], 270.0)
    elif match := verb and clause.take(r"(?:by )?(?P<n>[+-]?\d+(?:\.\d+)?)"):
        degrees = float(match["n"])
    elif clause.word("about"):
        degrees = 180.0
    else:
        return None
    way = clause.one_of("rotation")
    phrase = _thing(clause)
    clause.take(
        r"(?:on|about|around|toward|towards|to|from|seen from|viewed from) (?:the )"
        r"?(?:zq[a-z][a-z]x|lens|camera|us|me|top|above|spot|axis|y|z)(?: axis)?"
    )
    if not verb or phrase is None or not clause.is_empty:
        return None
    share = (-abs(degrees) if way == "right" else degrees) / 360
    return _object("turn", phrase, share) if share % 1 else None


def _distance(clause: Clause) -> tuple[float | None, str]:
    """(distance, "units", "metres" or "" for sizes) that a clause says."""
    if match := clause.take(
        rf"(?:by |about |some |of |like )*{NUMBER} ?(?P<u>{TABLE['unit', 'mm']}|"
        rf"{TABLE['unit', 'cm']}|{TABLE['unit', 'm']}|{TABLE['unit', 'inch']}|"
        rf"{TABLE['unit', 'foot']}|{TABLE['unit', 'yard']})(?: more)?"
    ):
        unit = next(u for u in METRES if re.fullmatch(TABLE["unit", u], match["u"]))
        return _value(match["n"]) * METRES[unit], "metres"
    if match := clause.take(rf"(?:by )?{NUMBER} ?units?"):
        return _value(match["n"]), "units"
    if match := clause.take(
        rf"(?:by )?{NUMBER} ?(?:times )?(?:of )?(?:its |his |her |their )?(?:own )?(?:sizes?|"
        rf"heights?|widths?|lengths?)"
    ):
        return _value(match["n"]), ""
    if match := clause.take(rf"(?:by )?{NUMBER} %"):
        return _value(match["n"]) / 100, ""
    return (1.0, "") if clause.word("much") else (0.25, "") if clause.word("little") else (None, "")


def _move(clause: Clause) -> Change | None:
    verb = clause.word("verb", "move")
    far, unit = _distance(clause)
    if not verb and unit != "metres":
        return None
    match = re.search(
        rf"(?P<side>{'|'.join(TABLE['side', v] for v in SIDES)}) the (?P<of>{STAND_IN})",
        clause.text,
    )
    first = THING.search(clause.text) or PRONOUN.search(clause.text)
    if match and first and first.start() < match.start("of"):
        clause.take(re.escape(match[0].strip()))
        side = next(v for v in SIDES if re.fullmatch(TABLE["side", v], match["side"]))
        place = Place(side, f"the {match['of']}")  # type: ignore[arg-type]
    else:
        side = clause.one_of("way")
        if not side:
            return None
        place = Place(side)  # type: ignore[arg-type]
    phrase = _thing(clause)
    clause.take(
        r"from the zq[a-z][a-z]x|from (?:here|there)|to (?:the )?side|toward(?:s)? the "
        r"zq[a-z][a-z]x|against the zq[a-z][a-z]x"
    )
    if phrase is None or not clause.is_empty:
        return None
    if phrase == IT and place.side in ("up", "down", "back") and not unit and not place.of:
        return None  # "bring it down" is said of tones
    if place.of:
        far, unit = None, ""
    place = Place(place.side, place.of, unit == "units", unit == "metres")
    return _object("move", phrase, far, place)


SIDES: tuple[Side, ...] = ("left", "right", "front", "behind", "on", "beside")


def _copy(clause: Clause) -> Change | None:
    count = _count(clause)
    if count is None:
        return None
    phrase = _thing(clause)
    if phrase is None:
        return None
    while clause.take(
        r"(?:exactly |just )?(?:same|identical|equal|like|similar)(?: as| to| like)?(?: the)"
        r"?(?: zq[a-z][a-z]x| (?:first|existing|other|original|old)(?: one)?| it| this one| "
        r"that one| this| that)?"
    ):
        pass
    place = Place("beside", phrase)
    if match := clause.take(
        rf"(?P<side>{'|'.join(TABLE['side', v] for v in SIDES)}) (?:the (?P<of>{STAND_IN})|"
        rf"it|the (?:first|original|other|existing|old)(?: one)?)"
    ):
        side = next(v for v in SIDES if re.fullmatch(TABLE["side", v], match["side"]))
        place = Place(side, f"the {match['of']}" if match["of"] else phrase)  # type: ignore[arg-type]
    elif side := clause.one_of("way"):
        place = Place({"forward": "front", "back": "behind", "up": "on"}.get(side, side), phrase)  # type: ignore[arg-type]
        if side == "down":
            return None
    else:
        clause.take(
            r"(?:all )?(?:along|around|in|at|by|to|over|across|near|against|from) (?:the )"
            r"?(?:zq[a-z][a-z]x|row|line|a row|a line|x|y|z|here|there)(?: along (?:x|y|z|"
            r"the zq[a-z][a-z]x))?"
        )
    clause.take(r"in a (?:row|line|circle)|evenly spaced|side by side")
    if not clause.is_empty:
        return None
    if count < 1 or count > 20:
        raise Refused("copies")
    return _object("copy", phrase, count if count > 1 else None, place)


def _count(clause: Clause) -> float | None:
    """Number of copies that a clause asks for; None where it asks for none."""
    count = 1.0
    verb = clause.word("verb", "copy")
    if match := clause.take(
        rf"(?:x ?)?{NUMBER} ?(?:times|time|x|copies|duplicates|clones)(?: more)?|x ?(?P<x>\d+)"
    ):
        count = float(match["x"]) if match["x"] else _value(match["n"])
    elif (
        match := clause.take(
            rf"{NUMBER} (?:more|extra|additional|other|identical|same|further|new)(?: of| "
            rf"identical| same| like)*"
        )
    ) or (match := clause.take(rf"(?:another|other|extra) {NUMBER}(?: of)?")):
        count, verb = _value(match["n"]), True
    elif clause.word("again"):
        verb = True
    elif match := verb and clause.take(NUMBER):
        count = 1.0 if match["n"] in ("a", "an", "half") else _value(match["n"])
    return count if verb else None
