"""Sentences that no route does, each with the reason and the nearest thing that can be done."""

from __future__ import annotations

import re
import unicodedata
from difflib import SequenceMatcher

from gsedit.errors import Said
from gsedit.words.lexicon import near_styles, sets, style_words, styles
from gsedit.words.scan import normalised, scanned


class Refused(Exception):
    """Kind of refusal of a sentence, and the words that stopped it."""


SAY = "gsedit changes color, material, tone, light, weather, season, style and objects"
REASONS = {
    "empty": "the sentence is empty: say what should change, as in 'make it snow'",
    "language": f"only English is read: {SAY}; say it as in 'paint it red'",
    "question": f"this asks for no change: {SAY}; say what should change, as in 'make it warmer'",
    "geometry": Said(
        "this would make or reshape something: what is in the scene can be removed, moved, turned, "
        "scaled and copied ('remove the bear'), and a scene's file put in ('put hat.ply on the "
        "table')",
        "any-sentence",
    ),
    "insert": Said(
        "what is put in is the file of a scene: name it, as in 'put hat.ply on the table'",
        "any-sentence",
    ),
    "everything": "this leaves no scene: say what should stay, as in 'keep only the bear', or go, "
    "as in 'remove the bear'",
    "unreal": "a shadow or a reflection is no object: lighten it, as in 'lift the shadows', or "
    "remove what throws it, as in 'remove the bear'",
    "undo": "nothing is overwritten, so there is nothing to undo: go on with the scene before the "
    "edit, which edit.json beside the edited one names ('scene')",
    "size": "objects are scaled by 0.1 to 10 times: say less, as in 'make it twice as big'",
    "distance": "a scene does not know how long a meter is: say a share of the object's size or "
    "units of the scene's file, as in 'move it left by half its height' or 'by 0.3 units'",
    "copies": "up to 20 copies are made at a time: say fewer, as in 'put three more on its left'",
    "negation": "this names what must not be, or takes away what no route takes away: say what it "
    "should be instead, as in 'paint it blue'",
    "two": "this asks for two things of one part that exclude each other: say one, as in "
    "'paint it red'",
    "direction": "this does not say which way: say more or less, as in 'more contrast'",
    "amount": "this amount is out of range: give from -100 % to 500 %, of light to 200 %, as in "
    "'20 % brighter'",
    "strength": "weather and seasons have one strength: say them plain, as in 'make it rain'; a "
    "painting's is an option, as in --strength 0.5",
    "side": "fog, clouds and weather come from no side: leave the side out, as in 'add fog'",
    "kept": "this says what stays, and that cannot be told from what changes: name both, as in "
    "'paint the vase red, but not the table'",
    "nonsense": f"this asks for no change that is known: {SAY}, as in 'a bronze statue at night'",
}
"""Message to a person, by the kind of refusal."""


_POLITE = r"(?: (?:please|now|again))*[.! ]*$"
ODD = (
    (rf"^(?:please )?(?:undo|redo|revert|roll back)(?: (?:it|that|this|all|everything"
     rf"|(?:the|my|your) (?:last|previous)? ?(?:edit|change|step|one|thing)s?))*{_POLITE}", "undo"),
    (rf"^(?:please )?(?:remove|delete|erase|clear|get rid of) (?:absolutely )?(?:everything|all|it "
     rf"all|all of it|all (?:of )?the (?:things|objects)|the (?:whole |entire )?scene){_POLITE}",
     "everything"),
)  # fmt: skip
"""Turns of phrase that take all back or away, and the kind of refusal of each."""


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
    return next((kind for pattern, kind in ODD if re.search(pattern, text)), None)


def reason(refused: Refused) -> str:
    """Message to a person for a refusal, with the words that stopped it."""
    kind, *words = refused.args
    if kind == "style":
        return no_style(words[0])
    if kind == "unknown":
        some = " or ".join(repr(each) for each in words[1:])
        nearest = f"the nearest are {some}" if some else "give a color, as in '#c04000'"
        return f"nothing here is called {words[0]!r}: {nearest}; gsedit list looks shows all"
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
    *some, last = near_styles().get(what, spelled)
    nearest = f"the nearest are {', '.join(some)} and {last}"
    return Said(f"no painting style resembles {what!r}: {nearest}", "styles")
