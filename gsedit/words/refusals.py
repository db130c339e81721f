"""Sentences that no route does, each with the reason and the nearest thing that can be done."""

from __future__ import annotations

import re
import unicodedata
from difflib import SequenceMatcher
from pathlib import Path

from gsedit.errors import Said
from gsedit.words.lexicon import lines_of, near_styles, patterns, sets, style_words, styles
from gsedit.words.scan import normalised, scanned


class Refused(Exception):
    """Kind of refusal of a sentence, and the words that stopped it."""


SAY = re.compile(r"\b(?:say|as in) '([^']+)'")
"""Sentences of reasons.txt that are offered."""
REASONS = {
    kind: Said(told, move, tuple(SAY.findall(told)))
    for kind, move, told in lines_of(Path(__file__).with_name("reasons.txt"))
}
"""Message to a person, by the kind of refusal."""
ODD = patterns("odd")
"""Phrases that take all, or a coat, back or away; files that nothing reads: how each is refused."""


def first_refusal(sentence: str) -> str | None:
    """Kind of refusal of a sentence by its letters and first words; None for one to be read."""
    words, letters = scanned(sentence), [each for each in sentence if each.isalpha()]
    if not letters and not any(word.kind == "number" or word.color for word in words):
        return "empty"
    if sum("LATIN" not in unicodedata.name(each, "") for each in letters) > len(letters) / 3:
        return "language"
    plain = [word.text for word in words if word.kind not in ("mark", "number")]
    foreign = sum(text in sets()["foreign"] for text in plain)
    if foreign >= 2 and foreign >= len(plain) / 2:
        return "language"
    text = normalised(sentence)
    return next((kind for kind, pattern in ODD if re.search(pattern, text)), None)


def reason(refused: Refused) -> Said:
    """Message to a person for a refusal, with the words that stopped it."""
    kind, *words = refused.args if all(refused.args) else ("nameless",)
    if kind == "style":
        return no_style(words[0])
    if kind == "unknown":
        what, *near = words
        some = " or ".join(map(repr, near))
        nearest = f"the nearest are {some}" if some else "give a color, as in '#c04000'"
        told = f"nothing here is called {what!r}: {nearest}; gsedit list looks shows all"
        return Said(told, offers=tuple(near), of=what)
    return REASONS[kind]


NEAREST = 3
"""Styles that are named where none resembles what is asked for."""


def no_style(what: str) -> Said:
    """The refusal of what no painting style resembles, with the nearest ones, or those whose words
    are spelled most like it."""
    likeness = dict.fromkeys(styles(), 0.0)
    for phrase, name in style_words().items():
        likeness[name] = max(likeness[name], SequenceMatcher(None, what, phrase).ratio())
    spelled = sorted(likeness, key=lambda name: -likeness[name])[:NEAREST]
    *some, last = near = tuple(near_styles().get(what, spelled))
    nearest = f"the nearest are {', '.join(some)} and {last}"
    return Said(f"no painting style resembles {what!r}: {nearest}", "styles", near, what)
