"""Marks of the network in a sentence, as words: each change that is asked for, and what stays."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from string import ascii_lowercase

from gsedit.words import colors, lexicon
from gsedit.words.called import FILE_NOUN
from gsedit.words.scan import DETERMINERS, scanned

VOCABULARY = Path(__file__).with_name("vocabulary.txt")
"""Pieces of words, one a line, in the order of the network's embeddings."""
WORD = re.compile(r"[^\W\d_]+|\d+(?:[.,]\d+)?|\S")
"""A word, a number, or one other sign."""
LONGEST_WORD = 40
"""Letters of a word that is still cut into pieces."""
AFTER_THING = ("color", "material", "finish", "state", "turn", "mark", "made", "fill", "conj")
"""Kinds of words behind the name of a thing: "the stele gold" is not of steel."""
MOST_PIECES = 160
"""Pieces of a sentence that are read."""
FIRST, LAST, UNKNOWN = "[CLS]", "[SEP]", "[UNK]"


@dataclass(frozen=True)
class Pieces:
    """A sentence as the network reads it."""

    text: str
    words: tuple[tuple[int, int], ...]
    """First letter and end of each word in the text."""
    ids: tuple[int, ...]
    """Numbers of the pieces, with one before the first word and one after the last."""
    first: tuple[int, ...]
    """Index in `ids` of the first piece of each word."""
    last: tuple[int, ...]
    """Index in `ids` of the last piece of each word."""

    def said(self, start: int, end: int) -> str:
        """The text from a word to a word, both counted."""
        return self.text[self.words[start][0] : self.words[end][1]]


@lru_cache(1)
def vocabulary() -> dict[str, int]:
    """Numbers of the pieces."""
    return {piece: at for at, piece in enumerate(VOCABULARY.read_text("utf-8").splitlines())}


def plain(word: str) -> str:
    """A word in lower case without accents."""
    apart = unicodedata.normalize("NFD", word.replace("\u2019", "'").lower())
    return "".join(each for each in apart if unicodedata.category(each) != "Mn")


@lru_cache
def known(*kinds: str) -> frozenset[str]:
    """Words of the lexicon and of colors, and determiners; or phrases of `kinds` of the lexicon."""
    if kinds:
        return frozenset(each for each, entry in lexicon.entries().items() if entry.kind in kinds)
    phrases = (*lexicon.entries(), *colors.colors(), *DETERMINERS)
    return frozenset(word for phrase in phrases for word in phrase.split())


STAYING = frozenset(("except", "without", "everything", "background"))
"""Words of what stays, in which a slip would change everything."""


def spelled(text: str) -> str:
    """A text without slips in words that neither lexicon nor network knows: letters swapped after
    the first, a letter doubled or not, a vowel left out, a key missed in "the" or "and"."""
    return WORD.sub(_spelled, text)


def _spelled(found: re.Match[str]) -> str:
    word = found[0]
    numbers, low = vocabulary(), plain(word)
    if not 2 < len(low) < 40 or low in numbers or low in known() or not low.isalpha():
        return word
    cut = [(low[:at], low[at:]) for at in range(1, len(low) + 1)]
    near = [a + b[1] + b[0] + b[2:] for a, b in cut if len(b) > 1]
    near += [w for w in ("the", "and") if len(low) == 3 and sum(map(str.__ne__, low, w)) == 1]
    if len(low) > 3:
        near += [a + b[1:] for a, b in cut if b and a[-1] == b[0]] + [a + a[-1] + b for a, b in cut]
    if len(low) > 5:
        near += [a + vowel + b for a, b in cut if len(b) > 2 for vowel in "aeiou"]
    if len(low) > 4:  # a tone that lacks a letter may be read as its opposite: "wamer"
        longer = {a + c + b for a, b in cut for c in ascii_lowercase}
        near += (known("state", "turn", "material") | STAYING) & longer
    right = (known() | STAYING).intersection(near)
    if right and DETERMINERS.intersection(found.string[: found.start()].lower().split()[-1:]):
        after = scanned(found.string[found.end() :])[:1]
        if after and (after[0].color or after[0].kind in AFTER_THING):
            right = right - known("material") - colors.colors().keys()
    return min(right, key=lambda each: (numbers.get(each, len(numbers)), each), default=word)


def pieces(text: str) -> Pieces:
    """The words of a text and their pieces; a text that is too long ends after `MOST_PIECES`."""
    numbers = vocabulary()
    ids, first, last, words = [numbers[FIRST]], list[int](), list[int](), list[tuple[int, int]]()
    for match in WORD.finditer(text):
        cut = _cut(plain(match[0]))
        if len(ids) + len(cut) >= MOST_PIECES:
            break
        first.append(len(ids))
        ids += cut
        last.append(len(ids) - 1)
        words.append((match.start(), match.end()))
    return Pieces(text, tuple(words), (*ids, numbers[LAST]), tuple(first), tuple(last))


@lru_cache(4096)
def _cut(word: str) -> tuple[int, ...]:
    """Numbers of the longest pieces of a word, from its start; the unknown one for none."""
    numbers, found, at = vocabulary(), list[int](), 0
    while at < len(word) <= LONGEST_WORD:
        ends = range(len(word), at, -1)
        whole = ("##" * bool(at) + word[at:end] for end in ends)
        end, piece = next(((e, p) for e, p in zip(ends, whole) if p in numbers), (at, ""))
        if not piece:
            return (numbers[UNKNOWN],)
        found.append(numbers[piece])
        at = end
    return tuple(found) or (numbers[UNKNOWN],)


DEEDS = (
    "tone", "paint", "material", "cover", "light", "weather", "look", "remove", "scale", "turn",
    "move", "copy", "insert", "shape", "other",
)  # fmt: skip
"""Kinds of changes; one class more is no change."""
TONES = (
    "", "brightness", "contrast", "saturation", "warmth", "hue", "sharpness", "highlights",
    "shadows", "grayscale", "sepia", "negative",
)  # fmt: skip
PARTS = ("span", "scene", "background", "it", "but")
"""Parts that change: words of the sentence, all, what is around the subject, a pronoun, all but
words."""
SIDES = ("", "left", "right", "behind", "front", "above")
"""Sides that light comes from."""
WAYS = (
    "", "left", "right", "up", "down", "front", "back", "beside", "on", "behind", "in front of",
    "left of", "right of",
)  # fmt: skip
"""Ways that an object goes, and sides of something."""
DEGREES = ("", "little", "much")
SIGNS = (0, 1, -1)
SPANS = ("of", "name", "amount", "to")
"""Words that are found for each change."""
KEPT = ("", "first", "later")
"""Whether a word begins or goes on with what stays."""
CHANGES = 4
"""Changes of a sentence at most."""
LONGEST = 24
"""Words of a span at most."""
ALIKE = (("paint", "material", "cover"), ("light", "weather", "look"))
"""Kinds of changes between which the name decides."""
NEAREST = 3
"""Names that are told where no word is known."""
ARTICLES = lexicon.pattern("articles")
"""Words that a phrase does not begin with."""
ARTICLE = re.compile(r"^(?:the )?(?:the|an?|its?|their|his|her|my)$", re.IGNORECASE)
"""A mark that names nothing."""
STILL = lexicon.pattern("still")
"""Words behind a thing that stays."""
OWNED = re.compile(r"^(?:the|my|our|your|his|her|its|their|this|that|these|those) ")
PRONOUN = re.compile(rf"^(?:{lexicon.spans('about')})$")
"""Phrases of what the sentence is about."""
BACKGROUND = re.compile(
    r"^(?:the |whole |entire |my |all )*"
    rf"(?:{lexicon.spans('around')}|(?:rest of|everything around) the .*)$"
)
"""Phrases of what surrounds the subject."""
WHOLE = re.compile(rf"^(?:the |whole |entire |this |full )*(?:{lexicon.spans('whole')})$")
"""Phrases of all that is there."""


def loose(phrase: str) -> bool:
    """Whether a phrase names no thing of its own."""
    return not phrase or any(each.match(phrase) for each in (BACKGROUND, WHOLE, PRONOUN))


def parts_alike(part: str, phrase: str) -> tuple[str, ...]:
    """Parts that mean the same beside a phrase."""
    if part == "but":
        return ("but",)
    if part == "background" or BACKGROUND.match(phrase):
        return ("span", "background", "but")
    return ("span", "it") if part == "span" and not loose(phrase) else ("span", "it", "scene")


CLASSES = {
    "deed": (*DEEDS, ""), "tone": TONES, "part": PARTS, "sign": SIGNS, "degree": DEGREES,
    "side": SIDES, "way": WAYS, "value": (),
}  # fmt: skip
"""Classes of each kind that the network tells; the weights have the list of values."""


@dataclass(frozen=True)
class Asked:
    """One change in the words of the sentence; "" for what is not said."""

    deed: str
    tone: str
    part: str
    of: str
    """Phrase of what changes, in small letters, with an article."""
    name: str
    amount: str
    """Number and unit, with the word before that tells what remains from what is added."""
    after: str
    """Word after the amount."""
    to: str
    sign: int
    degree: str
    side: str
    way: str
    value: str
    """Name that the lexicon has for what is meant, whatever the words are."""
    value_sure: float
    """Probability of the value."""
    near: tuple[str, ...]
    """The likeliest names of the lexicon, the value first."""
    sure: float
    """Least probability of what was chosen: the deed, its tone, its part and its sign."""

    @property
    def of_file(self) -> bool:
        """Whether a noun that stands for a file is what changes."""
        return FILE_NOUN in self.of.split()


@dataclass(frozen=True)
class Marked:
    """A sentence with what is marked in it."""

    text: str
    asked: tuple[Asked, ...]
    kept: tuple[str, ...]
    """Phrases of what stays."""
    refused: float
    """Probability that nothing can be done."""
    more: float
    """Probability of a change after the last one, which is not told."""
    kept_more: float
    """Largest probability that a word begins what stays, of those that are not told to."""
    marks: tuple[tuple[int, int], ...] = ()
    """First letter and end in the text of all that is marked."""

    @property
    def left(self) -> str:
        """The text with strokes in place of all that is marked."""
        text = self.text
        for first, last in self.marks:
            text = f"{text[:first]}{'|' * (last - first)}{text[last:]}"
        return text


def phrase(text: str) -> str:
    """A phrase as it names a thing: small letters, no marks, with an article."""
    plain = re.sub(r"[^\w\s'#/-]", " ", text.lower().replace("\u2019", "'"))
    plain = ARTICLES.sub("", re.sub(r"\s+", " ", plain).strip(" '-/"))
    plain = re.sub(r"^(it|them|him) (?!all\b|and\b).*", r"\1", plain)
    return plain if OWNED.match(plain) or PRONOUN.match(plain) else f"the {plain}"


def told(cut: Pieces, scores: Mapping, values: tuple[str, ...]) -> Marked:
    """Marks by the scores of one sentence: see `gsedit.words.marks.network.Marker`."""
    chances = {name: each.softmax(-1) for name, each in scores.items()}
    asked, spans, more = list[Asked](), list[tuple[int, int]](), 0.0
    things = list[tuple[int, int] | None]()
    for at in range(CHANGES):
        row = {name: chances[name][at] for name in (*CLASSES, "ends")}
        deed = int(row["deed"].argmax())
        if deed == len(DEEDS):
            more = 1 - float(row["deed"][deed])
            break
        change, found = _asked(cut, row, values)
        asked.append(change)
        spans += found.values()
        things.append(found.get("of"))
    kept, unsure = _kept(cut, chances["kept"], spans)
    spans += kept
    named = (STILL.sub("", phrase(one)) for each in kept for one in AND.split(cut.said(*each)))
    phrases = tuple(each for each in named if not ARTICLE.match(each))
    letters = tuple((cut.words[a][0], cut.words[b][1]) for a, b in spans)
    refused = float(chances["refused"][1])
    asked, more = _counted(cut.text, asked, letters, more)
    asked, fresh = _listed(cut, asked, things, letters)
    phrases = tuple(p for p in phrases if not any({*p.split()} <= {*of.split()} for of in fresh))
    return Marked(cut.text, tuple(asked), phrases, refused, more, unsure, letters)


AND = re.compile(r"(?<=\w)(?:,? and|,? &|,) (?!so\b|then\b|all\b)")
"""Words between two things."""
SAME = lexicon.pattern("same")
"""Words that ask the same of one thing more."""
BESIDE = lexicon.pattern("beside")
"""Words of a thing between two others in a list."""
AHEAD = lexicon.pattern("ahead")
"""Words of a thing before another."""


def _listed(
    cut: Pieces, asked: list[Asked], things: Sequence, marked: Sequence[tuple[int, int]]
) -> tuple[list[Asked], list[str]]:
    """(changes with those of things in a list that the marks leave out, phrases of these)."""
    found, fresh = list[Asked](), list[str]()
    for each, after, thing, then in zip(asked, [*asked[1:], None], things, [*things[1:], None]):
        found.append(each)
        start, at = (cut.words[thing[0]][0], cut.words[thing[1]][1]) if thing else (0, 0)
        gap = cut.text[at : cut.words[then[0]][0] if then else None] if thing else ""
        what = (
            (each.tone, each.sign) if each.deed == "tone" else each.deed in ALIKE[0] and each.name
        )
        ways = (False, after.name, (after.tone, after.sign)) if then and after else ()
        alike = ways and after and after.deed == each.deed and what in ways
        missed = (alike and BESIDE.fullmatch(gap)) or SAME.search(gap)
        ahead = AHEAD.search(cut.text[:start])
        if ahead and not any(a < ahead.end(1) and ahead.start(1) < b for a, b in marked):
            missed = missed or ahead
        if missed and "the same" in gap[missed.end() :][:14] and each.deed not in ALIKE[0]:
            missed = None  # "make it larger, the base the same"
        if missed and not loose(of := phrase(missed[missed.lastindex or 1])):
            found.append(replace(each, of=of))
            fresh.append(of)
    return found, fresh


NUMBER = lexicon.pattern("number")
"""An amount in a sentence."""
TAKEN_BACK = lexicon.pattern("taken")
"""Words that take back what is before them."""
MEASURED = ("tone", "scale", "turn", "move")
"""Deeds that have an amount."""


def _counted(
    text: str, asked: list[Asked], marked: Sequence[tuple[int, int]], more: float
) -> tuple[list[Asked], float]:
    """Changes with the amount that is said and not marked, where one alone can have it; and the
    chance of a change that is not told, 1 where an amount belongs to none."""
    back = max((each.start() for each in TAKEN_BACK.finditer(text)), default=0)
    if not NUMBER.search(text, back):
        back = 0
    for found in NUMBER.finditer(text):
        if found.end() <= back or any(a < found.end() and found.start() < b for a, b in marked):
            continue
        measured = [i for i, each in enumerate(asked) if each.deed in MEASURED]
        free = [i for i in measured if not asked[i].amount]
        if found[0].isdigit() and not measured:
            continue
        if len(free) != 1:
            return asked, 1.0
        after = text[found.end() :].split()[:1]
        one = replace(asked[free[0]], amount=found[0].lower(), after="".join(after).lower())
        asked = [one if i == free[0] else each for i, each in enumerate(asked)]
    return asked, more


def _asked(cut: Pieces, row: Mapping, values: tuple[str, ...]) -> tuple[Asked, dict]:
    """(a change, the words that it is marked in by what they are)."""
    kinds = {**CLASSES, "value": values}
    best = {name: row[name].max(-1) for name in kinds}
    of = {name: classes[int(best[name].indices)] for name, classes in kinds.items()}
    sure = {name: float(each.values) for name, each in best.items()}
    near = tuple(values[at] for at in row["value"].topk(NEAREST).indices.tolist())
    found = {name: _span(cut, *row["ends"][2 * k : 2 * k + 2]) for k, name in enumerate(SPANS)}
    thing, many = found["of"], found["amount"]
    if thing and many and thing[0] < many[0] <= thing[1] and cut.said(*many)[0].isdigit():
        found["of"] = (thing[0], many[0] - 1)
    said = {name: cut.said(*each) if each else "" for name, each in found.items()}
    named = phrase(said["of"]) if said["of"] else ""
    for kind, groups in (("deed", ALIKE), ("part", (parts_alike(of["part"], named),))):
        alike = next((each for each in groups if of[kind] in each), ())
        chances = [float(row[kind][CLASSES[kind].index(each)]) for each in alike]
        sure[kind] = max(sure[kind], sum(chances))
    signed = of["deed"] in ("tone", "scale")
    least = min(
        sure["deed"], sure["part"],
        sure["tone"] if of["deed"] == "tone" else 1.0, sure["sign"] if signed else 1.0,
    )  # fmt: skip
    before = after = ""
    if around := found["amount"]:
        words = [cut.text[a:b].lower() for a, b in cut.words]
        before = "".join(words[around[0] - 1 : around[0]])
        after = "".join(words[around[1] + 1 : around[1] + 2])
    amount = f"{before} {said['amount']}" if before in ("to", "at", "by") else said["amount"]
    change = Asked(
        of["deed"], of["tone"], of["part"], named, said["name"], amount.lower(), after, said["to"],
        of["sign"], of["degree"], of["side"], of["way"], of["value"], sure["value"], near, least,
    )  # fmt: skip
    used = {
        "of": of["part"] in ("span", "but"), "amount": True,
        "name": of["deed"] not in ("scale", "turn", "move", "copy", "remove"),
        "to": of["deed"] in ("move", "copy", "insert"),
    }  # fmt: skip
    return change, {name: each for name, each in found.items() if each and used[name]}


def _span(cut: Pieces, first, last) -> tuple[int, int] | None:
    """Words from the likeliest first to the likeliest last piece; None where none is likelier."""
    starts, ends = first[list(cut.first)], last[list(cut.last)]
    both = (starts[:, None] * ends).triu().tril(LONGEST)
    if not both.numel() or float(both.max()) < float(first[0] * last[0]):
        return None
    start, end = divmod(int(both.argmax()), len(cut.last))
    return start, end


def _kept(cut: Pieces, chances, spans: list) -> tuple[list[tuple[int, int]], float]:
    """(words of each phrase that stays, largest chance of one more beside the marked `spans`)."""
    rows = chances[list(cut.first)]
    label = rows.argmax(-1).tolist()
    found, at = list[tuple[int, int]](), 0
    while at < len(label):
        end = at
        if label[at]:
            while end + 1 < len(label) and label[end + 1] == 2:
                end += 1
            found.append((at, end))
        at = end + 1
    taken = {word for start, end in spans for word in range(start, end + 1)}
    free = [float(row[1]) for i, row in enumerate(rows) if not label[i] and i not in taken]
    return found, max(free, default=0.0)
