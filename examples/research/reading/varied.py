"""Variations of labelled sentences, and plain ones from the lexicon: other nouns and names, what
stays, remarks, corrections, two sentences in one, slips of the pen."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

from gsedit.words import colors, lexicon
from research.reading.labelled import Labelled, Slot, Span, value_of

SAID = Path(__file__).with_name("said.txt")
"""Texts that people say around a request: rows "kind: text", with {} for a thing."""
JOINS = (". ", " and ", ", and ", ", then ", "; ", " also ", ". And ", ", ", " + ", ". Then ")
SWAPPED = ("paint", "material", "cover", "look")
"""Deeds whose names are put in place of each other."""
VERB = re.compile(
    r"(?:make|paint|turn|remove|delete|put|cover|darken|brighten|move|rotate|scale|copy|add|light|"
    r"give|color|lower|raise|desaturate|erase|take)\b(?![^,;.]*(?:[,;.]|\bnot?\b|n't))",
    re.IGNORECASE,
)
"""A plain request: with a word of denial before it, it asks for nothing."""
SHORT = 0.3
"""Share of sentences that are plain ones of said.txt."""
NEWER = 160
"""Last rows of said.txt, of difficulties that were met late: half of the plain ones."""
THING = "the bear"
"""A thing in sentences that ask for nothing."""
NO_THING = re.compile(r"^(?:it|everything|all|the rest|rest|background|bg|me|us)\b", re.IGNORECASE)


def said(kind: str) -> list[str]:
    """Texts of a kind in said.txt."""
    rows = (line.partition(": ") for line in SAID.read_text("utf-8").splitlines())
    return [text for told, _, text in rows if told == kind]


@dataclass
class Varied:
    """Sentences to vary, with the things and names that they speak of."""

    sentences: Sequence[Labelled]
    rng: Random
    things: list[str] = field(default_factory=list)
    names: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Collect things and names."""
        self.names = {deed: [] for deed in SWAPPED}
        for each in self.sentences:
            for slot in each.slots:
                of, name = slot.spans.get("of"), slot.spans.get("name")
                if of and slot.classes.get("part") == "span":
                    self.things.append(each.text[slice(*of)])
                if name and slot.classes["deed"] in SWAPPED:
                    self.names[str(slot.classes["deed"])].append(each.text[slice(*name)])
        known = lexicon.looks()
        self.names["material"] += [m for m in known["material"] if value_of("material", m)]
        self.names["paint"] += list(colors.PLAIN) * 3
        self.names["look"] += known["style"]
        self.texts = {
            k: said(k) for k in ("keep", "except", "remark", "lead", "tail", "correction", "deny")
        }
        self.plain = [_parsed(each) for each in said("plain")]

    def one(self) -> Labelled:
        """A sentence, varied or not, or one from the lexicon."""
        rng = self.rng
        if rng.random() < SHORT:
            few = rng.choice((self.plain, self.plain[-NEWER:]))
            now = self.swapped(rng.choice(few), 0.8)
        else:
            now = rng.choice(self.sentences)
        if now.refused or rng.random() < 0.55:
            now = self.swapped(now, 0.5)
        if rng.random() < 0.05:
            now = self.corrected(now)
        if rng.random() < 0.05 and VERB.match(now.text) and not now.kept:
            text = now.text[0].lower() + now.text[1:].rstrip(".! ")
            return Labelled(rng.choice(self.texts["deny"]).format(text), (), refused=True)
        if rng.random() < 0.22:
            other = rng.choice(self.sentences) if rng.random() < 0.8 else rng.choice(self.plain)
            now = self.joined(now, self.swapped(other, 0.5))
        if rng.random() < 0.14:
            now = self.keeping(now)
        if rng.random() < 0.5:
            now = mirrored(now)
        if rng.random() < 0.1:
            now = self.remarked(now)
        if rng.random() < 0.06:
            now = now.edited((0, 0), rng.choice(self.texts["lead"]) + " ")
        if rng.random() < 0.1:
            now = replace(now, text=now.text.rstrip(".! ") + rng.choice(self.texts["tail"]))
        return self.slipped(now) if rng.random() < 0.12 else now

    def swapped(self, now: Labelled, chance: float) -> Labelled:
        """Other things and names in place of some."""
        if now.refused:
            return replace(now, text=now.text.replace(THING, self.rng.choice(self.things)))
        places = dict[Span, list[str]]()
        for slot in now.slots:
            of, name, deed = slot.spans.get("of"), slot.spans.get("name"), slot.classes["deed"]
            if of:
                places[of] = self.things
            if name and deed in SWAPPED:
                places[name] = self.names[str(deed)]
        for kept in now.kept:
            if not NO_THING.match(now.text[slice(*kept)]):
                places[kept] = self.things
        for at in sorted(places, reverse=True):
            if self.rng.random() < chance and now.cuts(at):
                now = now.edited(at, self.rng.choice(places[at]))
        return _revalued(now)

    def corrected(self, now: Labelled) -> Labelled:
        """Another name or thing first, which is taken back."""
        if len(now.slots) != 1 or now.refused:
            return now
        slot = now.slots[0]
        deed = str(slot.classes["deed"])
        what, pool = (
            ("name", self.names.get(deed)) if self.rng.random() < 0.7 else ("of", self.things)
        )
        at = slot.spans.get(what)
        if not at or not pool or not now.cuts(at):
            return now
        first = f"{self.rng.choice(pool)}{self.rng.choice(self.texts['correction'])} "
        return now.edited((at[0], at[0]), first)

    def joined(self, now: Labelled, other: Labelled) -> Labelled:
        """Two sentences in one."""
        many = len(now.slots) + len(other.slots)
        if now.refused or other.refused or not now.slots or not other.slots or many > 4:
            return now
        start = now.text.rstrip(" .!,;?")
        if any(end > len(start) for _, end in now.spans()):
            return now
        start += self.rng.choice(JOINS)
        late = other.edited((0, 0), start)
        return Labelled(late.text, now.slots + late.slots, now.kept + late.kept)

    def keeping(self, now: Labelled) -> Labelled:
        """The sentence with something that stays."""
        if not now.slots or now.refused or now.kept:
            return now
        parts = {slot.classes.get("part") for slot in now.slots}
        deeds = {slot.classes["deed"] for slot in now.slots}
        all_but = parts == {"scene"} and len(now.slots) == 1
        if deeds & {"insert", "copy", "other", "shape"} or not (all_but or parts <= {"span", "it"}):
            return now
        start = now.text.rstrip(" .!,;")
        if any(end > len(start) for _, end in now.spans()):
            return now
        before, after = self.rng.choice(self.texts["except" if all_but else "keep"]).split("{}")
        kept, text = list[Span](), start + before
        for count in range(2 if self.rng.random() < 0.2 and not all_but else 1):
            text += self.rng.choice((" and ", " or ", ", ")) if count else ""
            thing = self.rng.choice(self.things)
            kept.append((len(text), len(text) + len(thing)))
            text += thing
        slots = now.slots
        if all_but:
            but = {**slots[0].classes, "part": "but"}
            slots = (Slot(but, {**slots[0].spans, "of": kept[0]}),)
        return Labelled(text + after, slots, tuple(kept))

    def remarked(self, now: Labelled) -> Labelled:
        """The sentence beside a remark that asks for nothing."""
        remark, end = self.rng.choice(self.texts["remark"]), now.text.rstrip()[-1:]
        if self.rng.random() < 0.5:
            return now.edited((0, 0), f"{remark} ")
        return replace(now, text=f"{now.text}{' ' if end in '.!?' else '. '}{remark}")

    def slipped(self, now: Labelled) -> Labelled:
        """The sentence with two letters swapped, or one twice."""
        words = [m for m in re.finditer(r"[A-Za-z]{5,}", now.text)]
        if not words:
            return now
        at = self.rng.randrange((word := self.rng.choice(words)).start() + 1, word.end() - 1)
        two = now.text[at : at + 2]
        put = two[::-1] if self.rng.random() < 0.7 and len(two) == 2 else two[0] * 2 + two[1:]
        text = now.text[:at] + put + now.text[at + 2 :]
        return replace(now, text=text) if len(text) == len(now.text) else now


def _revalued(now: Labelled) -> Labelled:
    """A sentence whose slots have the values of the names that they have now."""
    slots = list[Slot]()
    for slot in now.slots:
        name, deed = slot.spans.get("name"), str(slot.classes["deed"])
        value = value_of(deed, now.text[slice(*name)]) if name and deed in SWAPPED else ""
        plain = {k: v for k, v in slot.classes.items() if k != "value"} if value else slot.classes
        slots.append(replace(slot, classes={**plain, **({"value": value} if value else {})}))
    return replace(now, slots=tuple(slots))


def mirrored(now: Labelled) -> Labelled:
    """The sentence with left for right; as it is where these words may say no side."""
    turns = any(slot.classes["deed"] == "turn" for slot in now.slots)
    idle = re.search(r"\bright (?:now|at|in)\b|all ?right|\bleft (?:alone|as)\b", now.text, re.I)
    sides = list(re.finditer(r"\b(?:left|right)\b", now.text, re.IGNORECASE))
    if turns or idle or not sides:
        return now
    for side in reversed(sides):
        put = {"left": "right", "right": "left"}[side[0].lower()]
        now = now.edited(side.span(), put.capitalize() if side[0][0].isupper() else put)
    flip = {"left": "right", "right": "left", "left of": "right of", "right of": "left of"}
    slots = tuple(
        replace(slot, classes={
            k: flip.get(str(v), v) if k in ("side", "way") else v for k, v in slot.classes.items()
        })
        for slot in now.slots
    )  # fmt: skip
    return replace(now, slots=slots)


HOLE = re.compile(r"\[(of|name|amount|to|keep)(\d?)=([^\]]+)\]")


def _parsed(row: str) -> Labelled:
    """A plain sentence with its marks: "[name=gold], [name2=night] | material it ; light scene";
    one that nothing can be done for ends in "| refuse"."""
    marked, _, told = row.rpartition(" | ")
    text, last, kept = "", 0, list[Span]()
    spans: dict[str, dict[str, Span | None]] = {}
    for hole in HOLE.finditer(marked):
        text += marked[last : hole.start()]
        place, last = (len(text), len(text) + len(hole[3])), hole.end()
        text += hole[3]
        if hole[1] == "keep":
            kept.append(place)
        else:
            spans.setdefault(hole[2] or "1", {})[hole[1]] = place
    text += marked[last:]
    if told == "refuse":
        return Labelled(text, (), tuple(kept), refused=True)
    slots = [_plain(each, spans.get(str(at), {})) for at, each in enumerate(told.split(" ; "), 1)]
    return Labelled(text, tuple(slots), tuple(kept))


def _plain(told: str, spans: dict[str, Span | None]) -> Slot:
    """A slot of a plain sentence by its words: "tone it tone=warmth sign=1"."""
    deed, part, *more = told.split()
    classes: dict[str, str | int] = {"deed": deed, "part": part, "degree": "", "side": ""}
    for each in more:
        key, _, value = each.partition("=")
        classes[key] = int(value) if key == "sign" else value.replace("_", " ")
    if deed in ("move", "copy"):
        classes.setdefault("way", "")
    if deed in ("tone", "scale", "turn"):
        classes.setdefault("sign", 0)
    absent = dict.fromkeys(("name", "amount", "to"))
    return Slot(classes, {**absent, **spans})
