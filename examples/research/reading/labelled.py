"""Sentences of people as the network of the reader sees them: each change with its words."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from gsedit.words.instruction import Change
from gsedit.words.marks import values
from gsedit.words.marks.marked import WORD
from gsedit.words.marks.network import DEEDS, TONES

Span = tuple[int, int]
"""First letter and end of words in a text."""
ALIKE = 0.74
"""Least likeness of words to those of a label that are not spelled as in the sentence."""
WAYS = (
    ("in front of", r"\bin front of\b|\bbefore the"), ("behind", r"\bbehind\b(?= \w)"),
    ("beside", r"\bnext to|beside|\bby\b|\bnear|alongside|against|close to|closer to"),
    ("left of", r"left (?:side )?of|left from"), ("right of", r"right (?:side )?of"),
    ("on", r"\bon\b|onto|upon|into|\bin\b|under|over|\bat\b|between|above|below|across"),
    ("left", "left"), ("right", "right"), ("up", r"\bup|higher|raise"), ("down", "down|lower"),
    ("front", "front|forward|nearer|toward|camera"), ("back", "back|away|behind|further|farther"),
)  # fmt: skip
"""Ways and sides by what a label says of a place."""
BUT = re.compile(
    r"(?:everything|everywhere|all|scene|the whole scene|anything|the rest|all things?)"
    r"(?: else| what is| that is| that's| there is| in the \w+)? ?"
    r"(?:but|except|exept|excluding|apart from|other than|besides?|save|bar|barring|minus|round|"
    r"around|outside|that isn't|that is not|which is not|not being|without)(?: for| of)? (.+)"
)
STOPS = re.compile(
    r"(?<![\w.])((?:(?:[-+]?\d+(?:[.,/]\d+)?|an?|one|two|three|half|third|quarter|full|whole|and|of)"
    r" )*(?:[-+]?\d+(?:[.,/]\d+)? ?)?(?:full |whole )?(?:stops?|ev)\b)",
    re.IGNORECASE,
)
"""Words of an amount in stops of light."""
NUMBER_WORDS = {
    "half": 0.5, "halve": 0.5, "halved": 0.5, "quarter": 0.25, "third": 1 / 3, "twice": 2.0,
    "double": 2.0, "doubled": 2.0, "triple": 3.0, "tripled": 3.0, "thrice": 3.0, "quadruple": 4.0,
    "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0, "six": 6.0, "seven": 7.0,
    "eight": 8.0, "nine": 9.0, "ten": 10.0, "twelve": 12.0, "fifteen": 15.0, "twenty": 20.0,
    "thirty": 30.0, "forty": 40.0, "fifty": 50.0, "sixty": 60.0, "seventy": 70.0, "eighty": 80.0,
    "ninety": 90.0, "hundred": 100.0, "couple": 2.0, "both": 2.0, "dozen": 12.0, "fifth": 0.2,
    "tenth": 0.1, "eighth": 0.125, "quarters": 0.25, "thirds": 1 / 3,
}  # fmt: skip
"""Numbers by the words that say them."""
UNITS = frozenset(
    ("%", "percent", "per", "cent", "stop", "stops", "degrees", "degree", "deg", "\u00b0", "times",
     "x", "fold", "m", "cm", "mm", "metres", "meters", "metre", "meter", "inches", "inch", "feet",
     "foot", "ft", "yards", "yard", "half", "quarter", "third", "thirds", "quarters", "fifth",
     "turn", "centimetres", "centimeters", "size", "sizes", "height", "width", "units", "/", "a",
     "and", "of", "its", "own", "as")
)  # fmt: skip
"""Words that go on with an amount."""


@dataclass(frozen=True)
class Slot:
    """One change: classes by name, and spans by name; None where the words are not in the text."""

    classes: dict[str, str | int]
    spans: dict[str, Span | None]
    """Without the names of what is said in other words than those of the label."""


@dataclass(frozen=True)
class Labelled:
    """A sentence with its changes and what stays."""

    text: str
    slots: tuple[Slot, ...]
    kept: tuple[Span, ...] = ()
    refused: bool = False

    def spans(self) -> list[Span]:
        """All that is marked."""
        return [*self.kept, *(s for each in self.slots for s in each.spans.values() if s)]

    def edited(self, at: Span, text: str) -> Labelled:
        """The sentence with other letters in a place, and all marks where they belong then; those
        of the place itself are of the new letters."""
        start, end = at
        shift = len(text) - (end - start)

        def moved(span: Span | None) -> Span | None:
            if span is None or span[1] <= start:
                return span
            if span[0] >= end and span != at:
                return span[0] + shift, span[1] + shift
            return span[0], span[1] + shift

        slots = tuple(
            replace(each, spans={k: moved(v) for k, v in each.spans.items()}) for each in self.slots
        )
        kept = tuple(filter(None, map(moved, self.kept)))
        return replace(
            self, text=self.text[:start] + text + self.text[end:], slots=slots, kept=kept
        )

    def cuts(self, at: Span) -> bool:
        """Whether a place is beside or around all that is marked, or is marked itself."""
        return all(s == at or s[1] <= at[0] or s[0] >= at[1] for s in self.spans())


def found(text: str, part: str) -> Span | None:
    """The place of the words of a label in a text; None for none that is near."""
    words = [(m[0].lower(), m.start(), m.end()) for m in WORD.finditer(text)]
    asked = [m[0].lower() for m in WORD.finditer(part)]
    for sought in (asked, asked[1:] if asked[:1] and asked[0] in ARTICLES else []):
        size = len(sought)
        for at in range(len(words) - size + 1) if sought else ():
            if [w for w, _, _ in words[at : at + size]] == sought:
                return words[at][1], words[at + size - 1][2]
    best, place = 0.0, None
    for size in range(max(1, len(asked) - 1), len(asked) + 3):
        for at in range(len(words) - size + 1):
            some = " ".join(w for w, _, _ in words[at : at + size])
            if (near := SequenceMatcher(None, some, " ".join(asked)).ratio()) > best:
                best, place = near, (words[at][1], words[at + size - 1][2])
    return place if best >= ALIKE else None


ARTICLES = frozenset(("the", "a", "an", "my", "this", "that", "its", "his", "her", "their"))


def read(files: Iterable[Path]) -> list[Labelled]:
    """Sentences of files of JSON lines, as tests/data/sentences/voices/guideline.md tells them."""
    rows = (json.loads(line) for file in files for line in file.read_text("utf-8").splitlines())
    return [labelled(row) for row in rows]


def labelled(row: dict[str, Any]) -> Labelled:
    """One row of such a file."""
    text = row["text"]
    kept = [found(text, each) for each in row.get("keep") or [] if not BUT.match(each)]
    slots = tuple(_slot(text, each) for each in row["changes"][:4])
    return Labelled(text, slots, tuple(filter(None, kept)), row["refuse"] == "must")


def _slot(text: str, change: dict[str, Any]) -> Slot:
    deed, name = change["do"], str(change.get("name", ""))
    classes: dict[str, str | int] = {
        "deed": deed if deed in DEEDS else "other",
        "degree": change.get("degree", ""), "side": change.get("side", ""),
    }  # fmt: skip
    spans = dict[str, Span | None]()
    if deed == "tone":
        classes["tone"] = name if name in TONES else ""
        name = str(change.get("color") or "")
    if deed in ("tone", "scale", "turn"):
        classes["sign"] = change.get("sign") or 0
    if deed in ("move", "copy", "insert"):
        to = str(change.get("to") or "").lower()
        classes["way"] = next((way for way, how in WAYS if re.search(how, to)), "")
        _mark(spans, "to", text, to)
    if value := value_of(deed, name):
        classes["value"] = value
    _mark(spans, "name", text, name)
    of = str(change.get("of", "scene"))
    but = BUT.match(of.lower())
    loose = {"scene": "scene", "the scene": "scene", "background": "background", "it": "it"}
    part = "but" if but else loose.get(of.lower(), "span")
    if part in ("span", "but"):
        _mark(spans, "of", text, but[1] if but else of)
        part = part if spans.get("of") else ""
    if part:
        classes["part"] = part
    amount = change.get("amount")
    stops = STOPS.search(text) if deed == "tone" and amount is not None else None
    place = stops.span(1) if stops else None if amount is None else _amount(text, float(amount))
    if amount is None or place:
        spans["amount"] = place
    return Slot(classes, spans)


def _mark(spans: dict[str, Span | None], name: str, text: str, label: str) -> None:
    """Add the words of a label; none is added for what is said in other words."""
    place = found(text, label) if label else None
    if place or not label:
        spans[name] = place


VALUES: dict[str, Callable[[str], Change | None]] = {
    "material": values.material, "cover": values.cover, "look": values.look,
    "light": values.light, "weather": lambda name: values.light(name) or values.look(name),
}  # fmt: skip


def value_of(deed: str, name: str) -> str:
    """Name of the lexicon for a label; "" for none."""
    change = VALUES[deed](name) if deed in VALUES and name else None
    plain = change.name.split(" with ")[0].split(" from ")[0] if change else ""
    return plain if change and change.color is None else plain.split(" ")[-1]


def _amount(text: str, amount: float) -> Span | None:
    """Words of the number that an amount may come from; None for none."""
    words = [(m[0].lower(), m.start(), m.end()) for m in WORD.finditer(text)]
    near = list[tuple[float, int]]()
    for at, (word, _, _) in enumerate(words):
        number = NUMBER_WORDS.get(word)
        if number is None and word[0].isdigit():
            number = float(word.replace(",", "."))
        if number is not None:
            near.append((min(abs(each - abs(amount)) for each in _meant(number)), at))
    if not near:
        return None
    off, start = min(near)
    if off > 0.03 * max(1, abs(amount)) and len(near) > 1:
        return None
    end = start
    while start and (
        words[start - 1][0] in NUMBER_WORDS or words[start - 1][0] in ("a", "an", "-", "+", "x")
    ):
        start -= 1
    while end + 1 < len(words) and (
        words[end + 1][0] in UNITS or words[end + 1][0] in NUMBER_WORDS
    ):
        end += 1
    while words[end][0] in ("and", "of", "a", "as", "its", "own", "x") and end > start:
        end -= 1
    return words[start][1], words[end][2]


def _meant(number: float) -> set[float]:
    """Amounts that a number may say."""
    n, part = number, min(number, 9.0)
    return {
        n, n / 100, 1 - n / 100, 1 + n / 100, n - 1, 1 - n, 1 / n if n else 0, n / 100 - 1, n + 1,
        n * 0.01, n * 0.3048, n * 0.0254, n * 0.001, 2**part - 1, 1 - 2**-part, n * 90, n * 180,
        n * 360, n + 0.5, n * 0.9144,
    }  # fmt: skip
