"""Materials, paints, lights and looks that a clause names."""

from __future__ import annotations

from dataclasses import replace

from gsedit.words import colors, lexicon
from gsedit.words.amounts import amount_of
from gsedit.words.clauses import NAMED, Clause
from gsedit.words.instruction import Change
from gsedit.words.scan import Word
from gsedit.words.small_looks import routed

Solids = list[tuple[int, Change]]
"""Changes with their places in a clause."""
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
        if word.kind == "material" and shaded:
            at += 1  # "stone gray" is a gray
            continue
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
    """Add a paint, or the color of veins to the material before."""
    word, last = words[at], found[-1] if found else None
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


def _leads(words: list[Word], at: int) -> bool:
    """Whether a color stands before a light, look or material that it belongs to."""
    near = words[at + 1 : at + 2]
    return any(word.kind in ("light", "look", "material") or word.value == "light" for word in near)


def _material(words: list[Word], at: int) -> tuple[Change, int]:
    """A material with the words beside it that belong to it, and where they end."""
    word, own = words[at], list[str]()
    color = word.color if word.text.endswith(f" {word.value}") else None
    for each in reversed(words[:at]):
        if not (each.kind in ("color", "finish", "material") or each.has("adj")):
            break
        own.insert(0, each.text)
        color = color or (each.color if each.kind == "color" else None)
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
    if _made(clause) and "look" in clause.kinds():
        return found
    times = lexicon.sets()["time"]
    for at, word in enumerate(clause.words):
        shines = word.value == "light" and _shines(clause, at)
        idle = word.text == "day" and sum(w.kind in NAMED for w in clause.words) > 1
        if idle or not (shines or word.kind in ("light", "look")):
            continue
        name, before = "lamp" if shines else word.value, clause.words[at - 1] if at else word
        color = before.color if before.kind == "color" else None
        change = Change("scene", "light", name, color, _strength(clause), "")
        if word.kind == "look":
            change = Change("scene", "look", name, None, None, "")
        if not any(_same_scene(change, each, times) for each in found):
            found.append(change)
    return [routed(directed(change, clause)) for change in found]


def _same_scene(one: Change, other: Change, times: frozenset[str]) -> bool:
    """Whether two say the same: two ways to draw, two kinds of weather, two times of day."""
    drawn = lexicon.sets()["drawn"]
    looks = one.kind == other.kind == "look" and (one.name in drawn) == (other.name in drawn)
    return looks or one.name == other.name or {one.name, other.name} <= times


def _strength(clause: Clause) -> float | None:
    """Share by which a light is stronger or weaker than usual: "a little mist", "harsh sun"."""
    if "turn" in clause.kinds():
        return None
    said = {word.value if word.kind == "intense" else word.kind for word in clause.words}
    said |= {word.text for word in clause.words}
    if share := amount_of(clause.words).share:
        return share
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
    """A light with the directions that a clause gives: "sunset from the left"."""
    said = [word.value for word in clause.words if word.kind == "direction"]
    said += ["from behind" for word in clause.words if word.text == "behind"]
    if change.kind != "light" or not said:
        return change
    return replace(change, name=" ".join([change.name, *dict.fromkeys(said)]))
