"""Clauses that ask for what lies or grows on things: snow, moss, dust, ice, leaves.

"Make it snow" is weather and "cover it in moss" a material: here are layers. Loads no torch.
"""

from __future__ import annotations

import re

from gsedit.words.instruction import Change
from gsedit.words.phrases import object_phrase

GROWTHS = {
    "snow": "snow",
    "moss": "moss",
    "dust": "dust",
    "ice": "ice",
    "leaves": "(?:(?:fallen|dead|dry|autumn|brown|withered) )*leaves",
}
"""Names of growths by gsedit.objects.growth.table, and words for each."""
NAME = f"(?P<what>{'|'.join(GROWTHS.values())})"
LITTER = f"(?P<what>{GROWTHS['leaves']}|dust)"
"""Growths that are nothing else, whatever is said of them."""
PLAIN = "(?P<what>(?:fallen|dead|withered) leaves)"
"""Growths that need no place."""
THICK = (
    r"(?:(?P<thick>(?:very )?(?:thick|thin|deep|heavy|dense|light|fine|delicate)|a lot of|lots of"
    r"|many|a few|a little|[0-9]+(?:\.[0-9]+)? ?(?:%|percent) (?:thicker|deeper|thinner)) )"
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
PATTERNS = tuple(
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
AMOUNTS = {
    "very thick": 2.0, "very deep": 2.0, "very heavy": 2.0, "very thin": -0.7, "thin": -0.5,
    "light": -0.5, "fine": -0.5, "delicate": -0.5, "a few": -0.5, "a little": -0.5,
}  # fmt: skip
"""Shares that a layer is thicker than usual, by its word; 1 for any other word."""
SINCE = re.compile(r" after (?:the |some |heavy )*(?:rain|storm|shower|snowfall)$")
"""Words that only say why something lies there."""
LEAST = 0.9
"""Largest share by which a layer is made thinner: no layer at all is no change."""
EVERYWHERE = ("everything", "the scene", "the whole scene", "all of it")


def grown(clause: str) -> Change | None:
    """The growth that a clause asks for; None where not all of its words say one."""
    clause = SINCE.sub("", clause)
    for pattern in PATTERNS:
        if match := pattern.fullmatch(clause):
            said = match.groupdict()
            amount = _amount(said["thick"]) if said.get("thick") else None
            where, name = said.get("x"), _name(said["what"])
            if where is None or where in EVERYWHERE:
                return Change("scene", "growth", name, None, amount, "object")
            if phrase := object_phrase(where, parts=True):
                return Change("subject", "growth", name, None, amount, "object", phrase)
    return None


def _amount(thick: str) -> float:
    """The share that a layer is thicker than usual, by a word or a number of percent."""
    if number := re.match(r"[0-9.]+", thick):
        share = float(number[0]) / 100
        return -min(share, LEAST) if thick.endswith("thinner") else share
    return AMOUNTS.get(thick, 1.0)


def _name(what: str) -> str:
    return next(name for name, words in GROWTHS.items() if re.fullmatch(words, what))
