"""One clause about an object as a change: remove, scale, turn, move, copy, insert; and about what
lies or grows on things. Loads no torch.

Patterns are of a whole clause as `gsedit.words.tokens` spells it: X is an object's phrase, MUCH an
amount, FAR a distance, AT a place.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from gsedit.words.amounts import amount_of
from gsedit.words.instruction import Change, Place, Side
from gsedit.words.lexicon import things
from gsedit.words.phrases import IT, object_phrase
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
NEAR, FAR = 0.25, 1.0
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
WORD = (
    r"(?:[+-]?\d+(?:[./]\d+)?|%|a|an|one|two|three|four|five|six|seven|eight|nine|ten|twelve"
    r"|fifteen|twenty|thirty|forty|fifty|sixty|seventy|eighty|ninety|hundred|and|half|thirds?"
    r"|quarters?|fifth|tenth|twice|thrice|double|triple|times|x|fold|bit|little|touch|tad|slightly"
    r"|somewhat|much|lot|far|way|even|about|around|roughly)"
)
"""A word of an amount."""
OWNS = "(?:the|my|this|that|these|those|our|your|his|her|their)"
HOLES = {
    "X": r"(?P<x>it|him|her|them|this|that|these|those|itself"
    rf"|{OWNS} [a-z][a-z0-9' ]*?(?! ones?\b)|(?!{OWNS}\b|a\b|an\b)[a-z]+(?: [a-z]+)??)",
    "MUCH": rf"(?P<much>{WORD}(?: {WORD})*?)",
    "FAR": rf"(?:by )?(?P<far>{DISTANCE})",
    "AT": r"(?:over )?(?P<at>(?:to|on|onto|upon|in|into|at|next|beside|near|nearer|by|behind|before"
    r"|left|right|leftwards?|rightwards?|forwards?|backwards?|back|close|closer|farther|further|away|up"
    r"|upwards?|down|downwards?|higher|lower|alongside|towards?|off)\b[a-z0-9' ]*?)",
    "WAY": r"(?P<way>clockwise|counter ?clockwise|anti ?clockwise"
    r"|(?:to (?:the|its) )?(?:left|right))",
    "NOW": r"(?: (?:as |that |than )?(?:it|he|she|they) (?:is|are|was|were)(?: now)?"
    r"| as (?:now|before))?",
    "SCENE": r"(?: (?:from|in) (?:the|this) (?:scene|picture|image|photo|shot|view))?",
    "REMOVE": "(?:remove|removing|delete|erase|eliminate|take away|take out|get rid of|clear away"
    "|edit out|throw away|throw out)",
    "BUT": "(?:but|except|except for|apart from|besides|other than)",
    "MOVE": "(?:move|shift|slide|nudge|relocate|scoot)",
    "TURN": "(?:turn|rotate|spin|swivel|pivot)",
    "OLD": "(?:its|the|their) (?:(?:current|original|present|old) )?size",
    "MANY": r"(?:two|three|four|five|six|ten|several|some|many|a few|\d+)",
}  # fmt: skip
ITS = ("the size of {X}", "{X} 's size", "(?:its|the) size")
"""Ways to name the size of something."""
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
        if match := pattern.fullmatch(clause):
            said = {name: text or "" for name, text in match.groupdict().items()}
            if change := make(said):
                return change
    return grown(clause)


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
    if amount is not None and place.of:
        return None  # "20 % next to the chair"
    place = Place(place.side, place.of, units)
    return Change("subject", "object", "move", None, amount, "object", change.phrase, place)


def _copied(said: Said) -> Change | None:
    """Another one of something, at a place or beside it."""
    x = said.get("x", "")
    x = IT if x in ("", "one") else x
    phrase = object_phrase(x)
    if phrase in (None, x) and x != IT and not re.match(OWNS, x):
        phrase = object_phrase(f"the {x}")
    place = phrase and side_of(said.get("at") or "beside", phrase)
    if not phrase or not place:
        return None
    return Change("subject", "object", "copy", None, None, "object", phrase, place)


def _counted(said: Said) -> Change | None:
    """Nothing: only one copy is made. Raises Refused for several of what is an object."""
    if _copied({"x": said.get("x", "")}):
        raise Refused("copies")
    return None


def _inserted(said: Said) -> Change | None:
    """The scene of a file, at a place; where the cameras look if none is said."""
    place = side_of(said["at"], IT) if said["at"] else None
    if said["at"] and place is None:
        return None
    return Change("scene", "object", "insert", None, None, "object", said["file"], place)


Make = Callable[[Said], Change | None]


def _rows(make: Make, *patterns: str) -> Iterator[tuple[re.Pattern[str], Make]]:
    """Patterns with their holes filled, and who makes a change of what they find."""
    for each in patterns:
        for its in ITS if "{ITS}" in each else ("",):
            yield re.compile(each.replace("{ITS}", its).format_map(HOLES)), make


PATTERNS = (
    *_rows(
        _isolated,
        "{REMOVE} (?:everything|all) {BUT} {X}{SCENE}",
        "(?:only keep|keep only|isolate|keep nothing but|show only) {X}",
        "{REMOVE} (?:(?:the )?(?:background|backdrop|surroundings|environment)|everything else"
        "|the rest(?: of the scene)?)(?: (?:around|behind) {X})?{SCENE}",
    ),
    *_rows(
        _removed,
        "{REMOVE} {X}{SCENE}",
        "take {X} (?:away|out)(?: of (?:the|this) (?:scene|picture|image|photo|shot))?",
        "get {X} out of (?:here|the scene)",
        "make {X} (?:disappear|vanish|go away|be gone)",
        "(?:i )?(?:want|need) {X} (?:gone|removed){SCENE}",
        "{X} (?:should|must|has to|have to|needs to|need to) (?:go|go away|disappear|vanish"
        "|be gone|be removed|be deleted|be erased){SCENE}",
        "the (?:scene|picture|image|same) without {X}",
    ),
    *_rows(
        _unwanted,
        "(?:i )?do not (?:want|need) {X} (?:(?:in )?(?:there|here)(?: any ?more)?|any ?more)",
    ),
    *_rows(
        _scaled,
        "(?:make|have|render|want) {X} (?:{MUCH} )?(?P<more>bigger|larger|smaller|tinier)"
        "(?: by (?P<by>.+))?",
        "(?:by )?(?:{MUCH} )?(?P<more>bigger|larger|smaller)(?: by (?P<by>.+))?",
        "(?:scale|resize|size) {X} (?P<more>up|down)(?: by {MUCH})?",
        "(?:scale|size) (?P<more>up|down) {X}(?: by {MUCH})?",
        "(?:scale|resize) {X} by (?:a factor of )?{MUCH}",
        "(?P<more>enlarge|magnify|shrink) {X}(?: by (?:a factor of )?{MUCH})?",
        "(?P<more>increase|reduce|decrease) {ITS}(?: by {MUCH})?",
        "{X} (?:is|are|looks|look|seems) (?:{MUCH} )?too (?P<more>small|tiny|big|large|huge)",
    ),
    *_rows(
        _of_old,
        "(?:make|render|scale|want) {X} (?:to )?{MUCH}(?: of)? (?:as (?:big|large)|in size|{OLD})"
        "{NOW}",
        "{MUCH} (?:as (?:big|large)|{OLD}){NOW}",
        "(?:scale|resize|shrink|enlarge|set) {X} to {MUCH}(?: of)?(?: {OLD})?",
        "(?:reduce|increase|set) {ITS} to {MUCH}",
        "(?P<more>double|triple|halve) {ITS}",
        "(?P<more>double|triple|halve) {X} in size",
    ),
    *_rows(
        _turned,
        "{TURN} {X} (?:by )?{MUCH}(?: (?:degrees|degree|deg))?(?: {WAY})?",
        "{TURN} {X} {WAY} (?:by )?{MUCH}(?: (?:degrees|degree|deg))?",
        "{TURN} {X} (?:by )?(?:a )?(?P<part>half|quarter|three quarter)(?: of)?(?: a)? turn"
        "(?: {WAY})?",
        "{TURN} {X} (?:around|round|about|back to front|the other way(?: a?round)?)"
        "(?: (?:so|so that|such that) (?:it|he|she|they) (?:faces?|looks?|points?)"
        " (?:the other way|backwards?|away))?",
    ),
    *_rows(
        _moved,
        "(?P<verb>{MOVE}) {X} {AT}",
        "(?P<verb>{MOVE}) {X} {AT} {FAR}",
        "(?P<verb>{MOVE}) {X} {FAR} {AT}",
        "(?:put|place|set|bring|pull|push|drag) {X}(?: {FAR})? {AT}",
        "(?P<lift>lift|raise|lower) {X}(?: (?:up|down))?(?: {FAR})?",
    ),
    *_rows(
        _inserted,
        "(?:insert|add|put|place|set|load|import|drop|bring in) (?:the (?:scene|file|object) )?"
        r"(?P<file><\d+>)(?: (?:in|into) (?:the|this) scene)?(?: {AT})?",
    ),
    *_rows(
        _counted,
        "(?:(?:put|add|place|set|make|insert|create) )?{MANY} (?:more|other|additional|extra|copies"
        "|more copies|duplicates)(?: of)?(?: {X})?",
        "(?:copy|duplicate|clone) {X} {MANY} times",
    ),
    *_rows(
        _copied,
        "(?:copy|duplicate|clone|replicate) {X}(?: {AT})?",
        "(?:(?:put|add|place|set|make|insert|create|i want) )?(?:another|a second|one more|an extra"
        "|a copy of|a duplicate of|a clone of|another copy of|a further)(?: {X})?(?: {AT})?",
    ),
)


# ---- places and distances -----------------------------------------------------------------------


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
        return (NEAR if "slight" in kinds else FAR), False
    sized = re.search(rf"(?:%|{LENGTH})", text)
    number = next((w.number for w in words if w.kind in ("number", "fraction", "factor")), 1.0)
    return number / (100 if "%" in text else 1), not sized


# ---- layers: "make it snow" is weather and "cover it in moss" a material ------------------------

WITHERED = "|".join(things("withered"))
NAME = f"(?:(?:{WITHERED}) )*(?P<what>{'|'.join(things('growth'))})"
"""Growths by gsedit.objects.growth.table, with words that are said of leaves."""
LITTER = f"(?:(?:{WITHERED}) )*(?P<what>leaves|dust)"
"""Growths that are nothing else, whatever is said of them."""
PLAIN = "(?:fallen|dead|withered) (?P<what>leaves)"
"""Growths that need no place."""
THICKNESS = {word: float(share) for word, share in things("thickness").items()}
"""Shares that a layer is thicker than usual, by its word."""
THICK = (
    rf"(?:(?P<thick>{'|'.join(THICKNESS)}"
    r"|[0-9]+(?:\.[0-9]+)? ?(?:%|percent) (?:thicker|deeper|thinner)) )"
)
LAYER = r"(?:layer|coat|coating|blanket|cover|covering|sheet|crust|carpet|film|glaze|pile|heap)s?"
ADD = (
    "(?:(?:add|put|lay|spread|scatter|sprinkle|strew|drop|place|pile|hang|make|give it"
    "|there should be) )?"
)
LIGHT_LAYER = LAYER.replace("layer", "layer|dusting|sprinkling", 1)
THING = r"[a-z][a-z0-9' ]*?"
COVER = r"(?:cover|coat|blanket|bury|strew|litter) (?P<x>[a-z][a-z0-9' ]*?) (?:with|in|under)"
WHERE = (
    r"(?: (?:all )?(?:on top of|on|onto|over|across|around|along|under|from|at|in) "
    r"(?P<x>[a-z][a-z0-9' ]*)| everywhere)"
)
LIES = (
    "(?:lie|lies|lying|settle|settles|grow|grows|growing|gather|gathers|collect|collects|pile up"
    "|piles up|hang|hangs|hanging)"
)
LAYERS = tuple(
    re.compile(pattern)
    for pattern in (
        rf"{ADD}(?:a |an |some )?{THICK}?{LAYER} of (?:fresh )?{NAME}{WHERE}?",
        rf"{COVER} (?:a |an |some )?{THICK}?{LAYER} of (?:fresh )?{NAME}",
        rf"{COVER} {THICK}(?:fresh )?{NAME}",
        rf"give (?P<x>{THING}) (?:a |an |some )?{THICK}?{LIGHT_LAYER} of (?:fresh )?{NAME}",
        rf"{COVER} (?:some )?{LITTER}",
        rf"{ADD}{THICK}(?:fresh )?{NAME}{WHERE}",
        rf"let (?:some |the )?{NAME} {LIES}{WHERE}?",
        rf"grow (?:some )?{NAME}{WHERE}",
        rf"(?:some )?{NAME} {LIES}{WHERE}",
        rf"{ADD}(?:some )?{THICK}?{LITTER}{WHERE}",
        rf"{ADD}(?:some )?{THICK}?{PLAIN}",
    )
)
SINCE = re.compile(r" after (?:the |some |heavy )*(?:rain|storm|shower|snowfall)$")
"""Words that only say why something lies there."""
THINNEST = 0.9
"""Largest share by which a layer is made thinner: no layer at all is no change."""
EVERYWHERE = ("everything", "the scene", "the whole scene", "all of it")


def grown(clause: str) -> Change | None:
    """The growth that a clause asks for; None where not all of its words say one."""
    clause = SINCE.sub("", clause)
    for pattern in LAYERS:
        if match := pattern.fullmatch(clause):
            said = match.groupdict()
            amount = _thickness(said["thick"]) if said.get("thick") else None
            where, name = said.get("x"), said["what"]
            if where is None or where in EVERYWHERE:
                return Change("scene", "growth", name, None, amount, "object")
            if phrase := object_phrase(where, parts=True):
                return Change("subject", "growth", name, None, amount, "object", phrase)
    return None


def _thickness(thick: str) -> float:
    """The share that a layer is thicker than usual, by a word or a number of percent."""
    if number := re.match(r"[0-9.]+", thick):
        share = float(number[0]) / 100
        return -min(share, THINNEST) if thick.endswith("thinner") else share
    return THICKNESS[thick]
