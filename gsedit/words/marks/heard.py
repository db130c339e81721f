"""Reading of a sentence by what the network marks in it, with checks apart from the network.

Words of what stays that nothing was made of, a request that is denied, and marks that are not sure
stop it. Loads torch when it reads.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from gsedit.words.amounts import DEFAULT
from gsedit.words.instruction import Change
from gsedit.words.lexicon import pattern, spans, things
from gsedit.words.marks.actions import LENGTH
from gsedit.words.marks.marked import ALIKE, TAKEN_BACK, Asked, Marked, loose, pieces, spelled, told
from gsedit.words.marks.meaning import DENIED, changes_of, stays
from gsedit.words.marks.values import plainly, told_by
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word, scanned

LET_BE = r"let (?:it|them|the \w+) be(?= *(?:$|[,;.!]|and |but ))"
STAYS = re.compile(rf"\b(?:{spans('stays')}|{LET_BE})\b", re.IGNORECASE)
"""Words of what stays."""
IDLE = pattern("idle")
"""Words beside which they say no such thing."""
TOLD_OF = pattern("told")
"""A sentence that only tells of a request."""
INSTEAD = pattern("instead")
"""Words after which what is asked follows what is denied."""
TOO = r"(?<!not )\btoo\b(?:\W+\w+){0,5}?\W+"
"""Words before a quality that there is too much of."""
TURNED = re.compile(rf"\b(?:{spans('turned')}|to(?= \w+$))\b|n't\b|'s\b", re.IGNORECASE)
"""Words beside which a quality may be what there is too much of."""
CLAUSE = re.compile(r"[^|,;.:!?\n]+")
TELLS = re.compile(rf"\b(?:{spans('tells')})\b|'(?:s|m|ve|t)\b", re.IGNORECASE)
"""Words of a clause that only tells what there is."""
VAGUE = pattern("vague").pattern + r"|(?<!apart )\b(?:from|in) {}\b"
"""A sentence that may mean that something goes, and may not."""
STAYING = re.compile(f"{STAYS.pattern}|{pattern('limited').pattern}", re.IGNORECASE)
"""Words without which a light of all that is there leaves nothing as it is, or changed by some."""
REFUSED = 0.6
"""Least probability that nothing can be done."""
UNSURE = 0.7
"""Least probability of what is marked that is taken."""
UNSURE_ALONE = 0.53
"""Least probability of one change, where no word is left that names something."""
MORE = 0.3
"""Largest probability of a change that is not told."""
KEPT_MORE = 0.1
"""Largest probability that a word begins what stays, of those that are not told to."""


@lru_cache(256)
def marked(text: str) -> Marked:
    """All that the network marks in a text. Loads torch."""
    import torch

    from gsedit.words.marks import network

    net, values = network.trained()
    cut = pieces(text)
    with torch.inference_mode():
        ids = torch.tensor([cut.ids])
        scores = net(ids, torch.ones_like(ids, dtype=torch.bool))
    return told(cut, {name: each[0].float() for name, each in scores.items()}, values)


def stays_unheard(text: str, changes: Sequence[Change]) -> str:
    """The words of what stays of which nothing was made; "" for none."""
    if any(c.target == "background" or c.keep for c in changes):
        return ""
    if any(change.kind == "object" and change.name == "remove" for change in changes):
        return ""
    found = STAYS.search(IDLE.sub(" ", text))
    return found[0] if found else ""


def denied(said: Marked) -> bool:
    """Whether a sentence only says what must not be."""
    ways = {w.value for w in scanned(said.text) if w.kind in ("state", "turn")}
    asks = said.kept or INSTEAD.search(said.text) or len({w[:-1] for w in ways}) < len(ways)
    return bool(TOLD_OF.search(said.text) or (DENIED.search(said.text) and not asks))


def unsure(said: Marked, files: Sequence[str] = ()) -> bool:
    """Whether what is marked, or that nothing more is, is not sure; that files are put in is."""
    asked = (each for each in said.asked if not (files and each.of_file))
    least = min((each.sure for each in asked), default=1.0)
    gone = (each for each in said.asked if each.deed == "remove")
    vague = any(re.search(VAGUE.format(re.escape(c.of or "it")), said.text, re.I) for c in gone)
    doubted = vague or any(turned(each, said) for each in said.asked)
    all_of_it = said.asked and all(c.deed in ALIKE[1] and c.part == "scene" for c in said.asked)
    stays = said.kept_more > KEPT_MORE and not (all_of_it and not STAYING.search(said.text))
    if len(said.asked) == 1 and alone(said.asked[0], said):
        return doubted or least < UNSURE_ALONE or said.more > MORE
    return doubted or least < UNSURE or said.more > MORE or bool(stays)


def alone(asked: Asked, said: Marked) -> bool:
    """Whether words name the only change of a sentence, and nothing beside it."""
    toned = {"state", "turn", "hue", "noun"} & {word.kind for word in scanned(said.text)}
    named = asked.name or asked.deed != "tone" or toned
    left = any(word.kind in things("naming") for word in scanned(said.left))
    return bool(named and not left) and asked.deed != "remove" and not STAYS.search(asked.of)


def turned(asked: Asked, marks: Marked) -> bool:
    """Whether a tone goes the other way than all words for it, in its clause where others change
    too, which no word beside turns around; or the way that there is too much of."""
    text, of = marks.text, [each.of.removeprefix("the ") for each in marks.asked]
    clauses = [each[0] for each in CLAUSE.finditer(text.lower()) if not TURNED.search(each[0])]
    thing = asked.of.removeprefix("the ")
    own = len(of) > 1 and not loose(asked.of)
    clauses = [each for each in clauses if own and [t for t in of if t in each] == [thing]]
    named = len(of) > 1 and asked.tone != "hue"
    found = (_of_tone(asked.tone, each, named=named) for each in (*clauses, text))
    said = next(filter(None, found), [])
    told = {word.value[-1] for word in said}
    if asked.deed != "tone" or len(told) != 1:
        return False
    same = (asked.sign > 0) == (told == {"+"})
    more = next((word.text for word in said if word.kind == "turn"), "")
    before = re.split(r"[,;.!?]|\b(?:so|then|please)\b", text[: text.lower().find(more)])[-1]
    led = TURNED.search(before) or " than " in text
    if not TURNED.search(text) or (more and not led and not same):
        return not same
    states = "|".join(re.escape(word.text) for word in said if word.kind == "state")
    return same and bool(states) and re.search(TOO + rf"(?:{states})\b", text.lower()) is not None


def _of_tone(tone: str, text: str, *, named: bool) -> list[Word]:
    """Words of a text that say more or less of a tone; with `named` also "contrast up"."""
    words = [word for word in scanned(text) if word.kind not in ("fill", "slight", "strong")]
    found = [w for w in words if w.kind in ("state", "turn") and w.value.split()[0] == tone]
    for at, word in enumerate(words if named else ()):
        ways = {each.kind for each in words[max(at - 1, 0) : at + 2]} & {"up", "down"}
        if word.kind == "noun" and word.value == tone and len(ways) == 1:
            way = "+" if ways == {"up"} else "-"
            found.append(replace(word, kind="turn", value=f"{tone} {way}"))
    return found


def unread(said: Marked, changes: Sequence[Change]) -> tuple[str, ...]:
    """Clauses of a text that say a quality which is in no change, but for those that only tell what
    there is, or are taken back."""
    end = max((m.end() for m in TAKEN_BACK.finditer(said.text)), default=0)
    toned = any(each.deed == "tone" for each in said.asked)
    made = f"{'; '.join(map(str, changes))} scales day"
    far = (LENGTH.match(each.amount or each.to) for each in said.asked if each.deed == "copy")
    named = (c.name for c in said.asked if c.deed in sum(ALIKE, ()) and not stays(c, said))
    names = dict.fromkeys(_unnamed(each, made.lower()) for each in named)
    return tuple(found[0] for found in far if found) + tuple(filter(None, names)) + tuple(
        found[0].strip()
        for found in CLAUSE.finditer(said.left)
        if found.end() > end and not TELLS.search(found[0])
        and any(_lost(word, made, toned=toned) for word in scanned(found[0]))
    )  # fmt: skip


def _unnamed(name: str, made: str) -> str:
    """Words of a name that say what is in no change: "night" of "fairy lights and night"."""
    words = scanned(name)
    hue = next((at for at, w in enumerate(words) if w.color and f"painted {w.text}" in made), -1)
    return " ".join(
        word.text for at, word in enumerate(words)
        if word.kind in ("unknown", *things("becomes")) and len(word.text) > 2
        and (at > hue or word.kind == "color") and word.text not in things("within")
        and not (word.color and word.color in made)
        and not any(each and each in made for each in (
            word.text, word.value, told_by("growth", word.text), told_by("material", word.text)
        ))
    )  # fmt: skip


def _lost(word: Word, made: str, *, toned: bool) -> bool:
    """Whether a word says a quality that is in no change."""
    if word.kind in ("state", "turn"):
        return not toned and word.value.split()[0] in DEFAULT
    return word.kind in things("becomes") and word.value not in made and word.text not in made


def heard(text: str, files: Sequence[str] = ()) -> tuple[tuple[Change, ...], bool, tuple[str, ...]]:
    """(changes that the network marks in a text, in which a noun stands for each of `files`;
    whether they are sure; words that are in none). Raises Refused."""
    text = spelled(plainly(text))
    said = marked(text)
    if denied(said):
        raise Refused("negation")
    if said.refused > REFUSED or not said.asked:
        asks = "question" if text.rstrip().endswith("?") else "nonsense"
        raise Refused("negation" if re.search(r"\b(?:not?|never|less)\b|n't\b", text) else asks)
    changes = tuple(changes_of(said, files))
    if not said.kept and (stopped := stays_unheard(text, changes)):
        raise Refused("kept", stopped)
    lost = unread(said, changes)
    whole = text.strip(" .!?") in lost and any(w.kind in things("frame") for w in scanned(text))
    return changes, not (whole or unsure(said, files)), lost
