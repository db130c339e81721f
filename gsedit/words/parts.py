"""Part of the scene that a clause speaks of, and clauses about what no route does."""

from __future__ import annotations

from gsedit.words.clauses import CONTENT, TARGETS, Clause
from gsedit.words.instruction import Change, Target
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word

DETERMINERS = frozenset(("the", "my", "this", "that", "our", "your", "his", "her", "their"))
OWNERS = frozenset(("its", "his", "her", "their"))
PARTS: dict[str, Target] = {
    "subject": "subject", "background": "background", "ground": "background",
}  # fmt: skip
MOST_UNKNOWN = {"paint": 1, "material": 1, "tone": 2, "light": 3, "look": 3}
"""Words that are not known, beside the name of a change that no verb or part goes with."""


Parts = list[tuple[int, str]]
"""Kinds of parts with their places in a clause."""


def named_parts(clause: Clause) -> Parts:
    """(place in the clause, kind of part) of each part that is named, in order."""
    words, found = clause.words, Parts()
    behind = light = False
    for at, word in enumerate(words):
        behind |= word.kind == "behind"
        light |= word.kind == "light"
        pointed = light and any(each.kind == "direction" for each in words[max(at - 3, 0) : at])
        cast = light and behind and not any(w.value in ("fog", "cloudy", "storm") for w in words)
        if word.kind in TARGETS and not pointed and not cast:
            found.append((at, "background" if behind and word.kind == "subject" else word.kind))
            behind = False
        elif word.kind == "unknown" and is_thing(words, at) and not pointed:
            found.append((at, "background" if behind else "subject"))
    return found


def is_thing(words: list[Word], at: int) -> bool:
    """Whether an unknown word is the name of what changes: "the fox", "gold sofa"."""
    if at and words[at - 1].kind in ("color", "material", "finish"):
        return True
    before = [
        word for word in words[:at] if word.kind not in ("color", "material", "finish", "state")
    ]
    return bool(before) and before[-1].text in DETERMINERS


def part_of(kind: str, change: Change) -> Target:
    """Part that a change of a clause about such a part changes."""
    if kind == "place":
        return "background" if change.kind in ("paint", "material") else "scene"
    return PARTS.get(kind, "scene")


def refuse_parts(clause: Clause) -> None:
    """Raise Refused for a clause about shape, an object, or a part that nothing finds."""
    words, kinds = clause.words, clause.kinds()
    scenic = kinds & {"light", "look"}
    unknown = [at for at, word in enumerate(words) if word.kind == "unknown"]
    if "shape" in kinds and not scenic and not kinds & {"noun", "hue"}:
        raise Refused("geometry")
    sided = any(word.value in ("from the left", "from the right") for word in words)
    asked = kinds & {"do", *TARGETS} and kinds & CONTENT
    if sided and not scenic and asked and not any(w.value == "light" for w in words):
        raise Refused("part")
    if "color" in kinds and any(word.text == "sky" for word in words) and not scenic:
        raise Refused("part")
    if "part" in kinds and not scenic and kinds & {"do", "act", "wish", *CONTENT}:
        raise Refused("part")
    for at, word in enumerate(words):
        alone = not any(each.kind in ("unknown", *TARGETS) for each in words[at + 1 : at + 3])
        if word.kind == "material" and at and words[at - 1].text in DETERMINERS and alone:
            raise Refused("part")  # "the rock" is a thing
    for at in unknown:
        if [word.text for word in words[max(at - 3, 0) : at - 1]] in (
            ["with", "a"],
            ["with", "an"],
        ):
            raise Refused("geometry")  # "with a red scarf"
        owned = at and (words[at - 1].kind == "poss" or words[at - 1].text in OWNERS)
        after = at and words[at - 1].kind == "subject"
        of = [word.text for word in words[at + 1 : at + 2]] == ["of"]
        whole = any(word.kind == "subject" for word in words[at + 1 : at + 4])
        if owned or after or (of and whole):
            raise Refused("part")
    if "act" in clause.tags() and not (scenic or kinds & {"noun", "turn", "style"}):
        _refuse_objects(words)


def _refuse_objects(words: list[Word]) -> None:
    """Raise Refused where an object would be added: "put a hat on it", "add a rose"."""
    verb = next(word.text for word in words if word.has("act"))
    for at, word in enumerate(words):
        new = at > 0 and words[at - 1].text in ("a", "an", "some", "another")
        plain = word.kind == "unknown" and not (at and words[at - 1].text in DETERMINERS)
        thing = word.kind == "subject" or (word.kind == "color" and " " not in word.text)
        if plain or (new and thing and verb != "give"):
            raise Refused("geometry")


def refuse_idle(clause: Clause, changes: list[Change]) -> None:
    """Raise Refused for a change that stands among words which nothing explains."""
    words = clause.words
    unknown = [
        at for at, word in enumerate(words) if word.kind == "unknown" and not is_thing(words, at)
    ]
    asked = clause.kinds() & {"do", "wish", "up", "down", *TARGETS}
    most = MOST_UNKNOWN[changes[0].kind] + (2 if asked else 0)
    if len(unknown) > most:
        raise Refused("nonsense")
