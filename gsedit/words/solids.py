"""Materials, paints, lights and looks that a clause names."""

from __future__ import annotations

from dataclasses import replace

from gsedit.words import colors, lexicon
from gsedit.words.amounts import amount_of
from gsedit.words.clauses import NAMED, TONES, Clause
from gsedit.words.direct import light_of, routed
from gsedit.words.instruction import Change
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word

Solids = list[tuple[int, Change]]
"""Changes with their places in a clause."""
LAMPS, UNSIDED, ENDS = (frozenset(lexicon.things(kind)) for kind in ("lamp", "unsided", "over"))
"""Lights whose brightness is their own, lights from no side, and words for what is over."""
THINNER = frozenset(("thinner", "sparser", "lighter"))
DENSER = frozenset(("denser", "thicker", "heavier"))
GLOW = "glow"
"""Material of any color."""
SHINES = ("shine", "shines", "shining")
"""Words for a finish by day, and for a glow at night."""
STRENGTHS = frozenset(("strength", "power", "intensity", "force"))
AMOUNTS = ("fraction", "factor", "unit")
"""Kinds of words that end an amount."""
ANY_DRAWING = frozenset(("drawing", "drawn", "hand drawn", "sketch", "sketched", "a painting"))
"""Words that say less than another way to draw beside them: "a charcoal sketch"."""
WEAKER, STRONGER = -0.4, 0.5
"""Shares of a light that "a little" and "strong" take and add."""


def solids(clause: Clause) -> Solids:
    """(place in the clause, change) of each material and paint, of target "subject"."""
    words, tags = clause.words, clause.tags()
    finish = next((word.value for word in words if word.kind == "finish"), None)
    painted, made = "paint" in tags, _made(clause)
    found, at = Solids(), 0
    while at < len(words):
        word = words[at]
        tinge = word.color and (word.has("tinge") or painted) and not made
        shaded = at + 1 < len(words) and words[at + 1].text in colors.PLAIN
        if word.kind == "material" and shaded and word.value != GLOW:
            at += 1  # "stone gray" is a gray
            continue
        if word.text in SHINES and any(each.value == "night" for each in words[at:]):
            found.append((at, routed(Change("subject", "material", GLOW, None, None, ""))))
        solid = word.kind == "look" and made and word.value in lexicon.materials()
        if (word.kind == "material" and not tinge) or solid:
            change, end = _material(words, at)
            if found and found[-1][1].kind == "material" and _joined(words, found[-1][0], at):
                found.pop()  # "rusty old iron" is iron
            found.append((at, change))
            at = end
            continue
        said = word.color and word.kind in ("color", "material") and not _leads(words, at)
        if said and (painted or not word.has("thing")):
            _add_color(words, at, finish, found)
        at += 1
    return _covered(words, found)


def _add_color(words: list[Word], at: int, finish: str | None, found: Solids) -> None:
    """Add a paint, or a color to the glow or the veins of the material before."""
    word, last = words[at], found[-1] if found else None
    if last and last[1].name == GLOW:
        found[-1] = (last[0], replace(last[1], color=word.color))  # "glow red"
        return
    trims = any(each.has("trim") for each in words[at + 1 : at + 2])
    if last and last[1].kind == "material" and trims:
        name = f"{last[1].name} with {word.text} {words[at + 1].text}"
        found[-1] = (last[0], replace(last[1], name=name))
    else:
        name = f"{finish} {word.text}" if finish else word.text
        found.append((at, Change("subject", "paint", name, word.color, None, "paint")))


def _covered(words: list[Word], found: Solids) -> Solids:
    """Changes with one material on another as one: "stone covered with moss"."""
    if len(found) != 2 or any(change.kind != "material" for _, change in found):
        return found
    (first, base), (last, over) = found
    between = [word.text for word in words[first + 1 : last]]
    if not {"covered", "cover", "overgrown", "with"} & set(between):
        return found
    if "with" not in between and "in" not in between:
        base, over = over, base
    return [(first, routed(replace(base, name=f"{base.name} with {over.name}")))]


def _joined(words: list[Word], first: int, last: int) -> bool:
    """Whether only adjectives stand between two materials."""
    return all(
        word.has("adj") or word.kind in ("color", "finish") for word in words[first + 1 : last]
    )


def _made(clause: Clause) -> bool:
    """Whether a clause says that something is made of what it names."""
    return any(word.has("made") and word.text not in ("from", "in") for word in clause.words)


def _made_of_look(clause: Clause) -> bool:
    """Whether something is made of what is a look too: "out of snow", but "a mosaic out of it"."""
    words, first = clause.words, [word.kind for word in clause.words].index
    look = first("look") if "look" in clause.kinds() else 0
    return look > 0 and _made(Clause(words=words[:look]))


def _leads(words: list[Word], at: int) -> bool:
    """Whether a color stands before a light, look or material that it belongs to."""
    if at and words[at - 1].value == GLOW:
        return False  # "glow green in the dark"
    near = words[at + 1 : at + 2]
    return any(word.kind in ("light", "look", "material") or word.value == "light" for word in near)


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


def _material(words: list[Word], at: int) -> tuple[Change, int]:
    """A material with the words beside it that belong to it, and where they end."""
    word, (own, color) = words[at], qualified(words, at)
    if any(each.kind == "down" for each in words[: at - len(own)][-1:]) and own:
        raise Refused("negation")  # "less dark wood"
    name = word.text if color else word.value
    trim, end = _trim(words, at + 1)
    full = " ".join([*own, name]) + (f" with {trim}" if trim else "")
    return routed(Change("subject", "material", full, color, None, "")), end


def _trim(words: list[Word], at: int) -> tuple[str, int]:
    """Trimming of a material: "green patina", "gray veins"; "" for none."""
    if at >= len(words) or words[at].text not in ("with", "and"):
        return "", at
    own = list[str]()
    for end, word in enumerate(words[at + 1 :], at + 2):
        if word.has("trim") or word.kind == "material":
            return " ".join([*own, word.text]), end
        if word.kind in ("color", "finish") or word.has("adj"):
            own.append(word.text)
        elif word.kind not in ("fill", "slight"):
            break
    return "", at


def scenes(clause: Clause) -> list[Change]:
    """Lights and looks of a clause, of target "scene": one time of day, each other one once."""
    found = list[Change]()
    if _made_of_look(clause):
        return found
    times = lexicon.sets()["time"]
    for at, word in enumerate(clause.words):
        shines = word.value == "light" and _shines(clause, at)
        idle = word.text == "day" and sum(w.kind in NAMED for w in clause.words) > 1
        if idle or not (shines or word.kind in ("light", "look")):
            continue
        name, before = "lamp" if shines else word.value, clause.words[at - 1] if at else word
        led = before.kind == "color" and _leads(clause.words, at - 1)
        color = before.color if led else None
        change = Change("scene", "light", name, color, _strength(clause), "")
        if word.kind == "look":
            change = Change("scene", "look", name, None, None, "")
        same = [each for each in found if _same_scene(change, each, times)]
        finer = _draws(change) and word.text not in ANY_DRAWING
        if same and finer:
            found.remove(same[0])  # "a painting by Monet"
        if finer or not same:
            found.append(change)
    return [routed(directed(change, clause)) for change in found]


def refuse_amount(clause: Clause, scenic: list[Change]) -> None:
    """Raise Refused where a light or look that may be there should end or be less of ("the rain is
    over", "halve the fog"), and where a look, which has one strength, should be more of."""
    words = clause.words
    first = next((at for at, word in enumerate(words) if word.kind in ("light", "look")), None)
    if not scenic or first is None:
        return
    told, given = {word.text for word in words}, amount_of(words)
    after = [word.text for word in words[first + 1 :]]
    ends = bool(after) and (after[-1] in ENDS or (after[-1] == "over" and "be" in clause.kinds()))
    ends |= bool(ENDS & set(after[:1])) and after[0] not in ("past", "clear", "done")
    ends |= "lift" in told and scenic[0].name == "fog"
    thinned = bool(told & THINNER) and not any(w.kind in ("subject", "background") for w in words)
    of_it = [word.text for word in words[:first] if word.text != "the"][-1:] == ["half of"]
    ends |= "enough" in clause.kinds() and not clause.kinds() & TONES  # "that is enough snow"
    fewer = given.factor is not None and given.factor < 1 and _bare(words) is None
    if ends or thinned or of_it or fewer:
        raise Refused("negation")
    more = told & DENSER or given.given
    if more and any(change.kind == "look" for change in scenic) and not clause.kinds() & TONES:
        raise Refused("strength")


def _bare(words: list[Word]) -> float | None:
    """Share of a light that is named right before it, or is its strength: 0.5 in "50 % fog", "half
    moonlight", "moonlight at half strength"."""
    given, texts = amount_of(words), [word.text for word in words]
    last = max((at for at, word in enumerate(words) if word.kind in AMOUNTS), default=-1)
    moved = any(word.kind in ("up", "down") for word in words)
    if last >= 0 and set(texts[last + 1 : last + 2]) & STRENGTHS and not moved:
        return given.share if given.factor is None else given.factor
    at = next((at for at, word in enumerate(words) if word.kind in ("light", "look")), 0)
    before = [word.kind for word in words[max(at - 2, 0) : at]]
    near = before[-1:] == ["fraction"] or before == ["number", "unit"]
    signed = any(word.kind == "number" and word.text[0] in "+-" for word in words)
    return given.share if near and not signed else None


def shone(scenic: list[Change], tone: list[Change]) -> tuple[list[Change], list[Change]]:
    """(lights and looks, tones) where one lamp and one brightness of it are the lamp's strength:
    "make the moonlight brighter"."""
    if [change.name for change in tone] != ["brightness"] or len(scenic) != 1:
        return scenic, tone
    if scenic[0].kind != "light" or light_of(scenic[0].name) not in LAMPS:
        return scenic, tone
    return [replace(scenic[0], amount=tone[0].amount)], []


def _same_scene(one: Change, other: Change, times: frozenset[str]) -> bool:
    """Whether two say the same: two ways to draw, two kinds of weather, two times of day."""
    looks = one.kind == other.kind == "look" and _draws(one) == _draws(other)
    return looks or one.name == other.name or {one.name, other.name} <= times


def _draws(change: Change) -> bool:
    return change.kind == "look" and change.name in lexicon.sets()["drawn"]


def _strength(clause: Clause) -> float | None:
    """Share by which a light is stronger or weaker than usual: "a little mist", "harsh sun"."""
    said = {word.value if word.kind == "intense" else word.kind for word in clause.words}
    said |= {word.text for word in clause.words}
    if (bare := _bare(clause.words)) is not None:
        return bare - 1 if bare != 1 else None
    given = amount_of(clause.words)
    if share := given.share if given.factor is None else given.factor - 1:
        return share
    if said & DENSER:
        return STRONGER
    if said & {"-", "slight", "thin", "dim"}:
        return WEAKER
    return STRONGER if said & {"+", "strong", "thick", "dense"} else None


def _shines(clause: Clause, at: int) -> bool:
    """Whether the word "light" is a light of its own: "light from the left", "a red light"."""
    kinds, colored = clause.kinds(), at > 0 and clause.words[at - 1].kind == "color"
    pointed = "direction" in kinds and not kinds & {"be", "degree"}
    other = kinds & {"light", "up", "down", "turn"} or ("state" in kinds and not pointed)
    return (pointed or colored) and not other


def directed(change: Change, clause: Clause) -> Change:
    """A light with the directions that a clause gives: "sunset from the left". Raises Refused for
    a side of what comes from none: "rain from the left"."""
    said = [word.value for word in clause.words if word.kind == "direction"]
    if change.kind == "look" or change.name in UNSIDED:
        if {"from the left", "from the right"} & set(said):
            raise Refused("side")
        return change
    said += ["from behind" for word in clause.words if word.text == "behind"]
    return replace(change, name=" ".join([change.name, *dict.fromkeys(said)])) if said else change
