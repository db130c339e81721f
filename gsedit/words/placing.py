"""Changes of the clauses of a sentence, each with the part of the scene that it is about."""

from __future__ import annotations

import re
from dataclasses import replace

from gsedit.words.instruction import Change, Target
from gsedit.words.reading import Reading, Refused
from gsedit.words.refusals import ACTS
from gsedit.words.scan import Word
from gsedit.words.small_looks import look_of
from gsedit.words.targets import (
    BACKGROUND,
    IT,
    KEEP_BACKGROUND,
    KEEP_SUBJECT,
    PLACE,
    SUBJECT,
)

WISH = re.compile(r"\b(?:make|turn|paint|want|color|like|in|as|should|give|use|render|look)\b")
"""Words that wish for a change."""


def join(
    changes: list[Change], found: list[Word], named: list[str], text: str, reading: Reading
) -> None:
    """Add a clause's changes to what was read, each with its part."""
    explicit = named[0] if named else None
    if not changes:
        _remark(found, explicit, text, reading)
    elif not _hints(changes, found, named, text, reading):
        _refuse_idle(changes, found, named, text)
        _append(changes, found, explicit, text, reading)
    else:
        return
    reading.target = explicit or reading.target


def _remark(found: list[Word], explicit: str | None, text: str, reading: Reading) -> None:
    """A clause without a change: a finish or a part of the change before. Raises Refused."""
    if not reading.changes:
        return
    last = reading.changes[-1]
    finish = next((word.value for word in found if word.kind == "finish"), None)
    if finish and last.kind == "paint":
        reading.changes[-1] = replace(last, name=f"{finish} {last.name}")
    elif ACTS.search(text) and _unknown(found) and not re.search("like|as if", text):
        raise Refused("geometry")
    elif explicit and explicit != PLACE and not reading.target:
        reading.changes[:] = [replace(c, target=_part(explicit, c)) for c in reading.changes]


def _hints(
    changes: list[Change], found: list[Word], named: list[str], text: str, reading: Reading
) -> bool:
    """Whether a clause names but the color of the change before, which is then brought up."""
    it = any(word.value == IT for word in found)
    if changes[0].kind != "paint" or len(changes) > 1 or named or it or not reading.changes:
        return False
    last = reading.changes[-1]
    asks = re.search(r"\b(?:paint|make|turn|color)\b", text)
    if last.kind not in ("light", "look", "material") or asks:
        return False
    if last.kind == "material":
        reading.changes[-1] = replace(last, color=changes[0].color, route="paint")
    return True


def _refuse_idle(changes: list[Change], found: list[Word], named: list[str], text: str) -> None:
    """Raise Refused for words of a change that nothing in the clause wishes for."""
    if named or WISH.search(text):
        return
    most = {"paint": 1, "material": 1, "tone": 2}.get(changes[0].kind)
    if most is not None and len(_unknown(found)) > most:
        raise Refused("nonsense")


def _append(
    changes: list[Change], found: list[Word], explicit: str | None, text: str, reading: Reading
) -> None:
    """Add changes to what was read, each with its part."""
    it = any(word.value == IT for word in found)
    own = explicit or it or not reading.changes or _again(changes, reading)
    mark = (explicit or reading.target) if own else None
    exclusive = reading.kept is not None
    of = re.search(r"\b(?:of|over|around|in|on|for) <s>", text) and not exclusive
    for change in changes:
        kind = change.kind
        if kind in ("tone", "look") or (kind == "light" and (exclusive or mark == BACKGROUND)):
            placed_there = mark and not (of and kind == "look")
            target = _part(mark, change) if mark and placed_there else "scene"
            change = replace(change, target=target)
        elif kind in ("paint", "material") and not explicit and mark:
            change = replace(change, target=_part(mark, change))
        reading.changes.append(change)


def _unknown(found: list[Word]) -> list[Word]:
    return [word for word in found if word.kind == "unknown"]


def _again(changes: list[Change], reading: Reading) -> bool:
    """Whether a clause goes on with the kind of change of the one before it."""
    return changes[0].kind == reading.changes[-1].kind == "tone"


def _part(mark: str, change: Change) -> Target:
    if mark == SUBJECT:
        return "subject"
    if mark == BACKGROUND:
        return "background"
    return "background" if mark == PLACE and change.kind in ("paint", "material") else "scene"


def placed(changes: list[Change], reading: Reading) -> list[Change]:
    """Changes that keep what the sentence leaves alone."""
    other: dict[str | None, Target] = {KEEP_SUBJECT: "background", KEEP_BACKGROUND: "subject"}
    if reading.kept is None:
        return changes
    target, alone = (
        other[reading.kept],
        {KEEP_SUBJECT: "subject", KEEP_BACKGROUND: "background"}[reading.kept],
    )
    if any(c.target == alone and c.kind == "tone" for c in changes) and len(changes) == 1:
        raise Refused("negation")
    others = any(change.target != alone for change in changes)
    return [
        change if others and change.target == alone else replace(change, target=target)
        for change in changes
    ]


def merged(changes: list[Change]) -> list[Change]:
    """Changes without those that repeat another one. Raises Refused for two colors of one part."""
    kept = list[Change]()
    for change in changes:
        same = [c for c in kept if c.kind == change.kind and c.target == change.target]
        if change.kind == "paint" and any(c.color != change.color for c in same):
            raise Refused("two")
        if any(
            c.name == change.name
            or (change.kind == "light" and look_of(c) and look_of(c) == look_of(change))
            for c in same
        ):
            continue
        kept.append(change)
    return kept
