"""Materials, paints, covers, lights and looks by the words that name them. Loads no torch."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

from gsedit.words import lexicon
from gsedit.words.amounts import Amount, tone
from gsedit.words.instruction import Change
from gsedit.words.lexicon import routed
from gsedit.words.marks.marked import Asked
from gsedit.words.names import LIGHTS, SCENERIES, light_of, lights
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word, normalised, scanned, tokens

GROWTH, LAMPS = lexicon.names("growth"), lights("own")
"""Layers that lie on what faces the sky, and lights whose brightness is their own."""
UNSIDED = LIGHTS - lights("sun") - lights("lamp")
"""Lights from no side."""
GLOW = "glow"
"""Material of any color."""
FROM = lexicon.things("from")
"""Words of a light's name for the side that it comes from."""
THICKER = {"little": -0.5, "much": 1.0}
"""Shares that a layer is thinner or thicker than usual."""
WEAKENS = ("dim", "weak", "thin", "less", "dark", "fain", "soft")
"""Beginnings of words after an amount that make a light weaker."""
STRONGER = {"little": -0.4, "much": 0.5}
"""Shares that a light is weaker or stronger than usual."""
SEAL = 0.5
"""Least probability of a name that the words do not say."""
REWRITTEN = lexicon.patterns("rewritten")
"""Patterns of requests in words that the network does not know, and those that it knows."""
LIKE = lexicon.pattern("like").pattern
"""A thing that something is like, behind words that say no more of it, at the end of a clause."""


@lru_cache(8)
def _facts(kind: str) -> dict[str, str]:
    """Names of a kind by the phrases that tell it, whatever else they mean."""
    rows = (*lexicon.rows(), *lexicon.rows_of(lexicon.ALIASES))
    return {
        phrase: value for told, value, phrases in rows if told == kind
        for phrase in (value, *phrases)
    }  # fmt: skip


def told_by(kind: str, name: str) -> str:
    """The name of a kind that the longest phrase within words tells; "" for none."""
    words, facts = tokens(name), _facts(kind)
    spans = (
        " ".join(words[start : start + size])
        for size in range(len(words), 0, -1)
        for start in range(len(words) - size + 1)
    )
    return next((facts[each] for each in spans if each in facts), "")


def plainly(text: str) -> str:
    """A text in words that the network knows, for those of dialect and of trades, for what things
    are like, and where it is but a name."""

    def plain(found: re.Match[str]) -> str:
        words = re.sub(r" +|(?<=\w)-(?=[a-z])", " ", found[found.lastindex or 0].lower())
        if found.lastindex:
            return f"like {lexicon.things('like').get(words) or told_by('material', words)}"
        return lexicon.things("said").get(words, found[0])

    for put, pattern in REWRITTEN:
        text = re.sub(pattern, put, text, flags=re.IGNORECASE)
    solid = (each for each in _facts("material") if lexicon.entries()[each].kind == "material")
    like = LIKE.replace("NAME", lexicon.spans("like", *solid))
    for pattern in (rf"(?<![\w-])(?:{lexicon.spans('said')})(?![\w-]| ?%)", like):
        text = re.sub(pattern, plain, text, flags=re.IGNORECASE)
    alone = None if "?" in text else _alone(text)
    frame = lexicon.things("frame").get(alone.kind) if alone else None
    return frame.format(alone.value) if alone and frame else text


def _alone(text: str) -> Word | None:
    """The one word of a text beside those without which it would say the same; None for more."""
    words = [w for w in scanned(text) if w.kind != "mark" and w.text not in lexicon.things("bare")]
    return words[0] if len(words) == 1 else None


def whole(name: str) -> Change | None:
    """The material, light or look that words are the name of, and nothing else; None for others."""
    word = _alone(name)
    make = {"material": material, "light": light, "look": look, "style": look}
    return make[word.kind](word.text) if word and word.kind in make else None


def material(name: str) -> Change | None:
    """The material that words name, with its color, finish and trimming; None for none."""
    found = _material(name)
    if found is None and (value := told_by("material", name)):
        found = _material(value)
    return found


def _material(name: str) -> Change | None:
    words = [word for word in scanned(name) if word.kind != "mark"]
    solid = [
        at for at, word in enumerate(words)
        if word.kind == "material" or word.value in lexicon.names("material")
    ]  # fmt: skip
    if not solid:
        return None
    at = _head(words, solid)
    word, (own, color) = words[at], qualified(words, at)
    trim = _trim(words, at + 1)
    full = " ".join([*own, word.text if color and not own else word.value])
    full += f" with {trim}" if trim else ""
    if word.value == GLOW and color is None:
        color = next((each.color for each in words if each.color and each is not word), None)
        full = GLOW
    return routed(Change("subject", "material", full, color, None, ""))


def qualified(words: list[Word], at: int) -> tuple[list[str], str | None]:
    """(words before a material that belong to it, the color among them or in its name)."""
    word, own = words[at], list[str]()
    color = word.color if word.text.endswith(f" {word.value}") else None
    for each in reversed(words[:at]):
        if not (each.kind in ("color", "finish", "material") or each.has("adj")):
            break
        own.insert(0, each.text)
        color = color or (each.color if each.kind == "color" else None)
    return own, color


def _head(words: list[Word], solid: list[int]) -> int:
    """The one of several materials that the others belong to: "rusty old iron" is iron, "stone
    covered with moss" stone."""
    first = solid[0]
    for at in solid[1:]:
        if all(w.has("adj") or w.kind in ("color", "finish", "material") for w in words[first:at]):
            first = at
    return first


def _trim(words: list[Word], at: int) -> str:
    """Trimming of a material: "green patina", "gray veins"; "" for none."""
    covered = [w.text for w in words[at : at + 3]]
    start = next((i for i, text in enumerate(covered) if text in ("with", "and", "in")), None)
    if start is None or not set(covered[:start]) <= {"covered", "overgrown"}:
        return ""
    own = list[str]()
    for word in words[at + start + 1 :]:
        if word.has("trim") or word.kind == "material":
            return " ".join([*own, word.text])
        if word.kind in ("color", "finish") or word.has("adj"):
            own.append(word.text)
        elif word.kind not in ("fill", "slight"):
            break
    return ""


def paint(name: str) -> Change | None:
    """The color that words name, with its finish; None for none."""
    words = scanned(name)
    colored = [word for word in words if word.color]
    colored = colored or [w for each in tokens(name) for w in scanned(each) if w.color]
    if not colored:
        return None
    word = max(colored, key=lambda each: len(each.text))
    finish = next((each.value for each in words if each.kind == "finish"), None)
    said = f"{finish} {word.text}" if finish and finish not in word.text else word.text
    return Change("subject", "paint", said, word.color, None, "paint")


def finish(name: str) -> Change | None:
    """The finish that words name, and nothing else: "matte", "satin finish"; None for other
    words, for satin and metallic, which are materials, alone, and for light that shines."""
    bare = re.sub(r"^(?:an?|very) | (?:finish|surface|sheen)$", "", name)
    said = bare if bare == "polished" else _facts("finish").get(bare, "")
    alone = bare == name and (bare == "metallic" or material(name))
    if not said or bare.startswith("shine") or alone:
        return None
    return Change("subject", "material", f"{said} finish", None, None, "material")


def color_of(name: str) -> str | None:
    """The color of words as "#rrggbb", a pure one where hue turns to it; None for none."""
    turned, pure = lexicon.things("hue"), lexicon.things("pure")
    for each in normalised(name).split():
        if found := pure.get(turned.get(each, each)):
            return found
    made = paint(name) if name else None
    return made.color if made else None


def cover(name: str, degree: str = "") -> Change | None:
    """The layer that words name, or the material that it looks like; None for none."""
    words = scanned(name)
    told = (each for word in words for each in (word.text, word.value) if each in GROWTH)
    if said := next(told, "") or told_by("growth", name):
        return Change("subject", "growth", said, None, THICKER.get(degree), "object")
    return material(name) or look(name)


def light(name: str, side: str = "", degree: str = "") -> Change | None:
    """The light or weather that words name; None for none."""
    words = scanned(name)
    lit = (word for word in words if word.kind == "light")
    word = min(lit, key=lambda each: each.value == "cloudy", default=None)
    if word is None and (value := told_by("light", name)):
        word = Word(value, "light", value)
    colored = next((w for w in words if w.color and w is not word and not w.has("shade")), None)
    if word is None and (colored or side or {"light", "lights", "lit", "lamp"} & set(tokens(name))):
        value = "lamp"
    elif word is None:
        return None
    else:
        value = word.value
    told = [w.value for w in words if w.kind == "direction" and w.value.startswith("from")]
    if value in UNSIDED:
        told = []
    elif side:
        told = [FROM[side]]
    full = " ".join([value, *dict.fromkeys(told[:1])])
    color = colored.color if colored and value == "lamp" else None
    return routed(Change("scene", "light", full, color, STRONGER.get(degree), ""))


def lamp(phrase: str) -> Change | None:
    """The lamp that a phrase names, whose brightness is its own; None for none."""
    found = light(phrase)
    return found if found and found.color is None and light_of(found.name) in LAMPS else None


def as_strong(change: Change, given: Amount, asked: Asked) -> Change:
    """A light as strong as is said: half of what is usual for "50 % fog", 0.3 more for "30 %
    brighter". Raises Refused for a strength of what has one, and a side of what has none."""
    share = given.share if given.factor is None else given.factor - 1
    if change.name.split(" from ")[0] in UNSIDED | SCENERIES and asked.side in ("left", "right"):
        raise Refused("side")
    if share is None:
        return change
    if change.route != "light":
        raise Refused("strength")
    if given.factor is None and asked.amount[:1] not in "+-":
        word = next((w.kind for w in scanned(asked.after) if w.kind in ("up", "down")), "")
        dimmer = word == "down" or asked.after.startswith(WEAKENS)
        share = -share if dimmer else share if word or asked.after.endswith("er") else share - 1
    return replace(change, amount=round(share, 4))


def look(name: str) -> Change | None:
    """The season, weather, drawing or painting that words name; None for none."""
    drawn = [word for word in scanned(name) if word.kind == "look"]
    word = max(drawn, key=lambda each: each.value in lexicon.styles(), default=None)
    if word is None and (toned := told_by("style", name)):
        return tone(toned, None)
    value = word.value if word else told_by("scenery", name)
    return routed(Change("scene", "look", value, None, None, "")) if value else None


def mixed(name: str) -> list[str]:
    """All painting styles that words name: they are mixed."""
    said = {word.value: word.text for word in scanned(name) if word.kind == "look"}
    styles = [each for each in said if each in lexicon.styles()]
    return [each for each in styles if said[each] not in ("drawing", "drawn") or len(styles) == 1]


def meant(value: str, sure: float, deed: str, side: str, degree: str) -> Change | None:
    """The change of a name of the lexicon that words mean without saying it; None for none."""
    if sure < SEAL:
        return None
    if deed in ("material", "cover"):
        return cover(value, degree) if deed == "cover" else material(value)
    found = light(value, side, degree) if light_of(value) == value.split(" from ")[0] else None
    return found if found and found.route == "light" else look(value)


def scenic(deed: str, name: str, side: str, degree: str) -> Change | None:
    """The change of words that name a light, a weather or a look; None for none."""
    found, other = look(name), light(name, side, degree)
    if deed != "look":
        found, other = other, found
    elif other and other.name == "lamp" and other.color:
        other = None  # a color in a look is no light
    done = (each for each in (found, other) if each and each.route != "pix2pix")
    return next(done, found)
