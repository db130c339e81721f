"""Checks on what a sentence was read as, apart from how it was read.

What the sentence says stays never meets what changes, and every word is in a change, in an
exception, in a remark, or told to be unread. Loads no torch.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from gsedit.words.actions import OtherClauses, actions_of
from gsedit.words.clauses import BECOMES, NEGATIONS
from gsedit.words.frames import Frames
from gsedit.words.instruction import Change
from gsedit.words.lexicon import sets, things
from gsedit.words.plain import plainly
from gsedit.words.refusals import Refused
from gsedit.words.scan import STAND_IN, Word, scanned
from gsedit.words.solids import ANY_DRAWING

HELD = frozenset(
    ("color", "material", "light", "look", "style", "turn", "state", "hue", "noun", "number",
     "fraction", "factor", "direction", "shape", "finish")
)  # fmt: skip
"""Kinds of words of which something must be made."""
UNHELD = re.compile(
    rf"\b(?:(?:keep|keeping|leave|leaving|preserve|spare|protect|stay|stays|staying|remain|"
    rf"remains|untouched|unchanged|except|excluding|other than|apart from|no need)\b|but "
    rf"(?:not )?(?:the|its|his|her|my|their|your) (?!zq)|(?:do|does|must|should|may|can|"
    rf"shall) not (?:be |get )?(?:change|changed|touch|touched|alter|altered)\b|(?:is|are|be|"
    rf"see .*) (?:clear|clean|dry|free)\b|(?:do not|dont|without|never) (?!want|like|need|"
    rf"see)[a-z]+ (?:the {STAND_IN}|background))"
)
"""Words of what stays that no frame took."""
HARD = frozenset(things("hard"))
"""Words that always stop where nothing is made of them."""
QUALITIES = (
    frozenset(things("other")) | frozenset(things("adjective")) | frozenset(things("opinion"))
)
"""Words for how something is done, or is."""
PLACES = frozenset(
    ("on", "over", "in", "at", "above", "by", "behind", "of", "with", "for",
     "under", "around", "onto", "from", "bathe", "light", "put", "outside", "across", "near")
)  # fmt: skip
"""Words before a thing on which light falls."""
FILLERS = frozenset(things("filler"))
"""Words of which nothing is made that say no more."""
LOOSE = frozenset(things("unheld"))
"""Words of these kinds of which nothing need be made: "the color red"."""


def meets(frames: Frames, changes: Sequence[Change]) -> str:
    """The words that say what stays where a change may meet it; "" where none does."""
    isolated = any(c.name == "remove" and c.target == "background" for c in changes)
    if not isolated and (held := UNHELD.search(re.sub(r"\bleaves\b", "", frames.asked))):
        return held[0]
    if only := re.search(
        rf"\b(?:only|just|solely|nothing but) (?:(?:on|for|in|at|to|with) )?the ({STAND_IN})",
        frames.asked,
    ):
        told = {change.phrase for change in changes} | {"on"}
        if not any(only[1] in each for each in told):
            return only[0]
    for change in changes:
        if (
            change.name in ("insert", "copy")
            or change.phrase.removeprefix("the ") in frames.left_out
        ):
            continue
        left_out = {*change.keep, *((change.phrase,) if change.target == "background" else ())}
        for kept in frames.kept:
            name = f"the {kept}"
            if kept.startswith("zq"):
                free = name in left_out
            elif kept == "it":
                free = change.target == "background" or change.phrase not in ("", "it")
            else:
                free = change.target == "subject" or (
                    kept == "rest" and change.target == "background"
                )
            if not free:
                return frames.said[0]
    return ""


def unread_in(text: str, changes: Sequence[Change]) -> list[str]:
    """Words of a text of which no change was made, those beside each other as one."""
    actions = actions_of(text)
    if actions is not None:
        others = [each.text for each in actions if isinstance(each, OtherClauses)]
        return [word for each in others for word in unread_in(each, changes)]
    words = scanned(text)
    whole = any(c.kind in ("light", "look") and c.target == "scene" for c in changes)
    told = {str(change) for change in changes}
    places = [c.place.of for c in changes if c.place]
    named = " ".join((*told, *places, *(f"{c.name} {c.phrase}" for c in changes)))
    times = sets()["time"]
    lit = {change.name for change in changes} & times
    amounts = {abs(change.amount) for change in changes if change.amount}
    found, before = list[str](), -2
    for at, word in enumerate(words):
        behind = any(w.kind == "behind" for w in words[:at]) and any(
            c.target == "background" for c in changes
        )
        beside = (whole or behind) and word.value.startswith("zq") and _led(words, at)
        beside |= _illustrates(words, at, named)
        if (
            beside
            or _denied(words, at)
            or not _is_lost(word, at, words, told, named, bool(lit), amounts)
        ):
            continue
        if at == before + 1:
            found[-1] = f"{found[-1]} {word.text}"
        else:
            found.append(word.text)
        before = at
    return found


def _is_lost(
    word: Word,
    at: int,
    words: list[Word],
    told: set[str],
    named: str,
    lit: bool,
    amounts: set[float],
) -> bool:
    """Whether nothing was made of a word."""
    if word.kind == "unknown":
        return word.text not in named and word.text not in FILLERS
    if word.value.startswith("zq"):
        return word.value not in named
    if word.kind not in HELD or word.text in LOOSE or word.text in ANY_DRAWING:
        return False
    if word.text in named or (word.value.split() or [word.text])[0] in named:
        return False
    if word.color and word.color in named:
        return False
    if word.kind in ("number", "fraction", "factor") and any(
        _near(each, word.number) for each in amounts
    ):
        return False
    if lit and word.value in sets()["time"]:
        return False
    try:
        other = plainly(" ".join(each.text for i, each in enumerate(words) if i != at))
    except Refused:
        return False
    return {str(change) for change in other} == told


def _denied(words: list[Word], at: int) -> bool:
    """Whether a word is what must not be, or what gives way: "not gold", "from black to white"."""
    if any(word.text in BECOMES for word in words[at + 1 : at + 2]):
        return True
    for word in reversed(words[:at]):
        if word.kind in ("mark", "conj"):
            return False
        if word.kind in NEGATIONS or word.text in ("from", "than", "instead of", "replace", "swap"):
            return True
    return False


def _illustrates(words: list[Word], at: int, named: str) -> bool:
    """Whether a word is in a comparison of which something was made: "as if Midas touched it"."""
    start = next((i for i in range(at - 1, -1, -1) if words[i].kind in ("simile", "asif")), None)
    if start is None or any(word.kind == "mark" for word in words[start:at]):
        return False
    return any(
        w.kind in ("material", "look", "light", "color", "style", "state")
        and w.value.split()[0] in named
        for w in words
    )


def _near(amount: float, number: float) -> bool:
    """Whether a change's amount is what a number says: 0.2 for 20, 0.5 for 1.5, for half."""
    said = (
        number,
        number / 100,
        abs(number - 1),
        abs(2 ** min(number, 9) - 1),
        number / 360,
        abs(number / 100 - 1),
    )
    return any(abs(amount - each) < 0.006 for each in said)


def _led(words: list[Word], at: int) -> bool:
    """Whether a thing only says where a light or a weather is, or of what a picture is."""
    before = [word.text for word in words[max(at - 3, 0) : at]]
    return bool(set(" ".join(before).split()) & PLACES)


def stops(words: str) -> bool:
    """Whether words that are not read stop the rest: a quality that is not made only is told."""
    typed = scanned(words)
    soft = [
        word.kind in ("finish", "state", "intense", "fill")
        or word.text in QUALITIES
        or word.has("adj")
        for word in typed
    ]
    return not all(soft) or any(word.text in HARD for word in typed)
