"""Reader of a sentence: typed words, clauses, changes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from gsedit.words import lexicon
from gsedit.words.actions import OtherClauses, actions_of
from gsedit.words.amounts import amount_of
from gsedit.words.chosen import looks_of
from gsedit.words.clauses import (
    CONTENT,
    DETERMINERS,
    PARTS,
    TARGETS,
    Clause,
    Parts,
    clauses,
    is_thing,
    named_parts,
    part_of,
    refuse_idle,
    refuse_parts,
)
from gsedit.words.direct import routed
from gsedit.words.instruction import Change, Target
from gsedit.words.phrases import IT, PRONOUNS
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word, scanned
from gsedit.words.solids import directed, refuse_amount, scenes, shone, solids
from gsedit.words.tones import asks_less, complains, hues, stressed, tones

Placed = list[tuple[int, Change]]
"""Changes with their places in a clause."""
ONLY = frozenset(("only", "just", "alone", "solely"))
BECOME = frozenset(
    ("turn", "turned", "change", "changed", "convert", "transform", "switch", "shift")
)
"""Verbs after which a part is what turns to something."""
DENIALS = frozenset(("not", "drop", "except", "keep", "limit", "down"))
"""Kinds of words that say what must not be."""
SOLID = ("material", "paint")
DULLER = {"glossy": "matte", "metallic": "matte", "matte": "glossy"}
"""Finish that is less of each: "bronze, but less shiny"."""


@dataclass
class Reading:
    """Progress of reading: what the clauses so far have named."""

    changes: list[Change] = field(default_factory=list)
    part: str | None = None
    """Kind of part that a clause named last."""
    others: set[int] = field(default_factory=set)
    """Indices of changes that apply to "everything else"."""
    limits: list[Word] = field(default_factory=list)
    direction: int = 0
    denied: bool = False
    unsaid: bool = False
    """Whether a tone is named without its direction."""
    bare: bool = False
    """Whether the last change is a quality that no verb goes with: "dull colors"."""
    run: int = 0
    """Number of changes in the list of nouns that is read."""


def plainly(text: str) -> list[Change]:
    """Changes that a text asks for which says nothing of what stays. Raises Refused."""
    words = scanned(text)
    actions = actions_of(text)
    if actions is None:
        changes = looks_of(text, _parsed)
        if not changes:
            raise _refusal(words)
    else:
        changes = [change for each in actions for change in _between(each)]
    turned = any(c.name in ("hue", "turn") or c.kind == "light" for c in changes)
    if any(word.value == "degrees" for word in words) and not turned:
        raise Refused("nonsense")  # "turn it purple by 30 degrees"
    return _merged(changes)


def _between(each: Change | OtherClauses) -> list[Change]:
    """An action, or the changes of clauses between actions. Raises Refused."""
    if isinstance(each, Change):
        return [each]
    words = scanned(each.text)
    changes = looks_of(each.text, _parsed)
    if not changes:
        raise Refused("nonsense")
    if each.goes_on:
        changes = [replace(c, target="subject") if c.kind == "tone" else c for c in changes]
    elif not any(word.text in PRONOUNS for word in words):
        return changes
    if each.it == IT:
        return changes
    own = [c.target == "subject" and not c.phrase for c in changes]
    return [replace(c, phrase=each.it) if mine else c for c, mine in zip(changes, own)]


def _parsed(words: list[Word]) -> list[Change]:
    """Changes that words name; empty where none does. Raises Refused."""
    reading, found = Reading(), clauses(words)
    for at, clause in enumerate(found):
        if "retract" in clause.kinds() and any(later.kinds() & CONTENT for later in found[at:]):
            reading = Reading()  # "red, I mean blue"
        if clause.void and (after := found[at + 1 : at + 2]) and after[0].kinds() & {"do", "wish"}:
            reading = Reading()  # "no, make it blue"
            continue
        if clause.void:
            raise Refused("negation")
        if clause.removed:
            raise Refused("removal")
        reading.limits += clause.limits
        reading.denied |= bool(clause.denied or clause.limits or clause.turned)
        _read_clause(clause, reading)
    names = {change.name for change in reading.changes}
    denied = {word.value for clause in found for word in clause.denied}
    if denied & names or (reading.denied and not reading.changes):
        raise Refused("negation")
    if reading.unsaid:
        raise Refused("direction")
    emits = lexicon.sets()["emits"]
    if reading.limits:
        raise Refused("kept", " ".join(word.text for word in reading.limits))
    merged = _merged(_for_others(reading.changes, reading))
    return sorted(merged, key=lambda change: bool(emits & set(change.name.split())))


def _read_clause(clause: Clause, reading: Reading) -> None:
    refuse_parts(clause)
    changes = _changes(clause, reading)
    parts = named_parts(clause)
    explicit = next((kind for _, kind in parts), None)
    if not changes:
        _remark(clause, explicit, reading)
    elif not _completes(clause, changes, parts, reading):
        refuse_idle(clause, [change for _, change in changes])
        painted = reading.changes and reading.changes[-1].kind == "paint"
        limits = "too" in clause.tags() or (painted and "color" in clause.kinds())
        if clause.turned < 0 and limits and reading.changes:
            return  # "night, but not too blue": a limit of what was asked
        _append(clause, changes, parts, reading)
    reading.part = explicit or reading.part


def _changes(clause: Clause, reading: Reading) -> Placed:
    """(place, change) of each change of a clause, of its parts yet unsaid. Raises Refused."""
    kinds, tags = clause.kinds(), clause.tags()
    scenic, solid = scenes(clause), solids(clause)
    cast = any(word.kind == "noun" and word.value == "hue" for word in clause.words)
    graded = (
        kinds & {"up", "down"} or tags & {"too", "lack", "cure"} or clause.lost or clause.turned
    )
    graded = graded or _hinted(clause) or stressed(clause, ("color",))
    material = any(change.kind == "material" for _, change in solid)
    colored = "color" in kinds and not scenic and not material
    if "hue" in kinds or (cast and not material) or (colored and graded):
        return [(0, change) for change in hues(clause)]
    off = any(word.text in ("off", "away") for word in clause.words)
    less = asks_less(clause) or tags & {"too", "cure"} or (off and bool(scenic))
    if (scenic or material) and less and not kinds & {"noun", "state"}:
        raise Refused("negation")
    if clause.lost and any(change.kind == "light" for change in scenic):
        raise Refused("negation")  # "remove the light from the left"
    refuse_amount(clause, scenic)
    if "too" in tags and "state" in kinds and not clause.turned:
        scenic = []  # "the sun is too bright" asks for no sun
    if scenic or solid:
        moved = {"turn", "style", *(("noun",) * bool(kinds & {"up", "down"}))}
        tone = tones(clause, 0) if kinds & moved else []
        if tone:
            solid = [each for each in solid if not _describes(clause, each[0])]
        scenic, tone = shone(scenic, tone)
    else:
        tone = tones(clause, reading.direction)
        nouns = [w.text for w in clause.words if w.kind == "noun" and w.value != "light"]
        unsaid = any("color" not in text for text in nouns)  # "change its color: blue"
        reading.unsaid |= unsaid and not tone and "be" not in kinds
    return [*solid, *((0, change) for change in (*scenic, *tone))]


def _describes(clause: Clause, at: int) -> bool:
    """Whether a color or material is a thing's own: "the red car". Raises Refused for one that is
    the name of a part: "the red"."""
    if not at or clause.words[at - 1].text not in DETERMINERS:
        return False
    if any(word.kind in ("unknown", *TARGETS) for word in clause.words[at + 1 : at + 2]):
        return True
    raise Refused("part")


def _hinted(clause: Clause) -> bool:
    """Whether a color is only hinted at: "a touch of blue"."""
    words = clause.words
    triples = zip(words, words[1:], words[2:])
    colors = sum(word.kind == "color" for word in words)
    return colors == 1 and any(
        one.kind == "slight" and of.text == "of" and hue.kind == "color" for one, of, hue in triples
    )


def _remark(clause: Clause, explicit: str | None, reading: Reading) -> None:
    """A clause without a change: a finish, a direction or a part of the change before."""
    kinds, last = clause.kinds(), reading.changes[-1] if reading.changes else None
    if kinds & {"up", "down"}:
        reading.direction = -1 if asks_less(clause) or "down" in kinds else 1
    if last is None:
        return
    odd = [at for at, word in enumerate(clause.words) if word.kind == "unknown"]
    if explicit and not kinds & {"be"} and any(not is_thing(clause.words, at) for at in odd):
        raise Refused("nonsense")  # half of what is asked is not known
    if last.kind in ("light", "look") and asks_less(clause) and not explicit:
        raise Refused("negation")  # "heavy fog, reduce it"
    if reading.bare and (kinds & {"up", "down"} or "mend" in clause.tags()) and last.amount:
        agrees = last.amount > 0 and "up" in kinds  # "vivid colors, more please"
        reading.changes[-1] = replace(last, amount=last.amount if agrees else -last.amount)
    less = asks_less(clause)
    finish = next((word.value for word in clause.words if word.kind == "finish"), None)
    finish = DULLER.get(str(finish)) if less else finish
    own = next((word.text for word in clause.words if word.has("adj") and not less), finish)
    given = amount_of(clause.words).share
    if given and explicit in PARTS and last.kind == "tone":  # "background -30 %"
        amount = given if given < 0 or not last.amount else math.copysign(given, last.amount)
        reading.changes.append(replace(last, target=PARTS[explicit], amount=amount))
    elif last.kind == "light":
        reading.changes[-1] = directed(last, clause)
    elif finish and last.kind == "paint":
        reading.changes[-1] = replace(last, name=f"{finish} {last.name}")
    elif own and last.kind == "material" and not explicit:
        reading.changes[-1] = routed(replace(last, name=f"{own} {last.name}"))
    elif explicit in PARTS and not reading.part and not clause.before.endswith("."):
        target = PARTS[explicit]
        reading.changes[:] = [replace(change, target=target) for change in reading.changes]
    reading.bare = False


def _completes(clause: Clause, changes: Placed, parts: Parts, reading: Reading) -> bool:
    """Whether a clause names but the color or the direction of the change before: "sunset, light
    from the left"."""
    if not reading.changes:
        return False
    last, change, kinds = reading.changes[-1], changes[0][1], clause.kinds()
    if last.kind == "light" == change.kind and not change.color:
        turned = directed(last, clause)
        if turned != last and ("light" not in kinds or change.name.startswith("sunny ")):
            reading.changes[-1] = turned
            return True
    asks = kinds & {"do", "wish"} or parts or len(changes) > 1
    if asks or change.kind != "paint" or last.kind not in ("light", "look", "material"):
        return False
    if last.kind != "look":
        reading.changes[-1] = directed(replace(last, color=change.color), clause)
    return True


def _append(clause: Clause, changes: Placed, parts: Parts, reading: Reading) -> None:
    """Add changes to what was read, each with its part."""
    it = any(word.text in ("it", "him", "them") for word in clause.words)
    same = bool(reading.changes) and changes[0][1].kind == reading.changes[-1].kind == "tone"
    joined = same and clause.before[-1:] not in (".", ";", "!", "?")
    goes_on = not reading.changes or it or joined
    carried = reading.part if goes_on else None
    if carried == "scene" and changes[0][1].kind in SOLID:
        carried = None  # "in this scene, make it gold"
    for at, change in changes:
        near = min(parts, key=lambda part: (abs(part[0] - at), -part[0]))[1] if parts else carried
        if change.kind == "look" and changes[0][1].kind in ("paint", "material"):
            near = None  # "a gold bear in snow"
        if near == "rest":
            reading.others.add(len(reading.changes))
        reading.changes.append(_placed(change, near, clause))
    _share(clause, len(changes), parts, reading)
    kinds = clause.kinds()
    quality = kinds & {"state", "intense", "hue"} and not kinds & {"do", "wish", "up", "down"}
    reading.bare = bool(quality) and not complains(clause)
    if kinds & {"up", "down"}:
        reading.direction = -1 if asks_less(clause) or "down" in kinds else 1


def _share(clause: Clause, count: int, parts: Parts, reading: Reading) -> None:
    """Give the tones of a list the part and the amount that its last noun is said with: "lower the
    brightness and contrast of the background by 10 %"."""
    kinds, share = clause.kinds(), amount_of(clause.words).share
    bare = not kinds & {"do", "wish", "up", "down", "be"} and clause.before in ("and", ",")
    last, end = reading.changes[-1], len(reading.changes) - count
    for at in range(end - reading.run * (bare and "noun" in kinds), end):
        each = reading.changes[at]
        amount = math.copysign(share, each.amount or 1) if share else each.amount
        target = last.target if parts else each.target
        reading.changes[at] = replace(each, amount=amount, target=target)
    reading.run = 0 if share or "noun" not in kinds else reading.run * bare + count


def _placed(change: Change, part: str | None, clause: Clause) -> Change:
    """A change with the part that it is about; a light is of the scene but for the background."""
    if part is None or part == "rest":
        return change
    lit = change.kind == "light" and not _alone(clause)
    told = {word.text for word in clause.words}
    pictured = change.kind == "look" and "of" in told and not told & ONLY
    whole = part == "subject" and (lit or pictured)  # "a sketch of the bear"
    ground = part == "ground" and change.kind in ("light", "look") and change.route != "style"
    return change if whole or ground else replace(change, target=part_of(part, change))


def _alone(clause: Clause) -> bool:
    """Whether a clause singles out the subject, or says what it turns to: "only the bear at night",
    "turn the bear to night"."""
    words = [word for word in clause.words if word.text not in DETERMINERS]
    return any(
        part.kind in ("subject", "unknown")
        and (before.text in ONLY or (before.text in BECOME and after.text in ("to", "into")))
        for before, part, after in zip(words, words[1:], [*words[2:], *words[:1]])
    )


def _for_others(changes: list[Change], reading: Reading) -> list[Change]:
    """Changes of "everything else" as those of what the others are not of."""
    named = {change.target for at, change in enumerate(changes) if at not in reading.others}
    rest: Target = "subject" if "background" in named else "background"
    return [
        replace(each, target=rest) if at in reading.others else each
        for at, each in enumerate(changes)
    ]


def _merged(changes: list[Change]) -> list[Change]:
    """Changes without those that repeat another. Raises Refused for two that exclude each other."""
    kept = list[Change]()
    for change in changes:
        if change.kind == "object":
            kept.append(change)
            continue
        beside = [c for c in kept if (c.target, c.phrase) == (change.target, change.phrase)]
        named = [c for c in beside if (c.kind, c.name) == (change.kind, change.name)]
        if change.name == "hue":
            named = [c for c in named if c.color == change.color]
        excluded = any((c.amount or 0) * (change.amount or 0) < 0 for c in named)
        if excluded or (change.kind in SOLID and any(_differ(c, change) for c in beside)):
            raise Refused("two")
        if not named:
            kept.append(change)
    return kept


def _differ(one: Change, other: Change) -> bool:
    """Whether two changes are materials or paints, and not the same one."""
    same = one.color == other.color if one.kind == "paint" else one.name == other.name
    return one.kind in SOLID and (one.kind != other.kind or not same)


def _refusal(words: list[Word]) -> Refused:
    """Why a sentence is refused none of whose words names a change."""
    kinds = {word.kind for word in words}
    if "finish" in kinds and "unknown" not in kinds:
        return Refused("finish")
    return Refused("negation" if kinds & DENIALS else "nonsense")
