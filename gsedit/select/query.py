"""A noun phrase as a query over segments, by the words of gsedit/words/things.txt and the names of
colors. Loads no torch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gsedit.words.colors import longest
from gsedit.words.lexicon import things
from gsedit.words.scan import MARKS, tokens

KNOWN = things("known")
"""Nouns that are known without a network, with the kind of segment that each names."""
THINGS, SKIPPED, UPRIGHT = (frozenset(things(kind)) for kind in ("thing", "skipped", "upright"))
COUNTS = {word: int(count) for word, count in things("many").items()}
"""Words of a plural, with the number of things that they say; 0 for any."""
ORDINALS = {word: int(place) for word, place in things("ordinal").items()}
SIZES = {word: int(sign) for word, sign in things("size").items()}
MOST = {word: (value.split()[0], int(value.split()[1])) for word, value in things("most").items()}
"""Superlatives with the order and the place in it: the first is the largest, or farthest there."""
SIDES, RELATIONS = things("side"), things("relation")
EXCEPT = things("except")


@dataclass
class Query:
    """One noun phrase, as a query over segments."""

    kind: str = "object"
    """One of the values of KNOWN, or object."""
    colors: tuple[str, ...] = ()
    """Hex colors that it is of."""
    other_than: tuple[str, ...] = ()
    """Hex colors that it is not of."""
    size: int = 0
    """-1 small, 1 large."""
    upright: bool = False
    """Whether the size is its height."""
    order: str | None = None
    place: int = 0
    """Place in the order, from 0; negative from the end."""
    relations: tuple[tuple[str, tuple[Query, ...]], ...] = ()
    plural: bool = False
    count: int = 0
    """Number of things that are said, 0 for any."""
    nouns: list[str] = field(default_factory=list)
    """Words that are none of these, in order."""
    excluded: tuple[Query, ...] = ()
    """Things that are left out."""

    @property
    def unknown(self) -> list[str]:
        """Nouns that cannot be known without a network."""
        return [noun for noun in self.nouns if noun not in THINGS]

    @property
    def asks_network(self) -> bool:
        """Whether any noun is not known, of what it is related to as well."""
        others = [each for _, ends in self.relations for each in ends]
        return bool(self.unknown) or any(each.asks_network for each in (*others, *self.excluded))

    @property
    def bare(self) -> bool:
        """Whether nothing but nouns that are not known tells the thing."""
        return not (
            self.colors or self.other_than or self.size or self.order or self.relations
        ) and self.kind in ("object", "subject")


def read_phrase(phrase: str) -> tuple[Query, ...]:
    """The things that a phrase names, one after the other; a phrase without words has none."""
    return tuple(map(_query, _listed([word for word in tokens(phrase) if word not in MARKS])))


def _listed(words: list[str]) -> list[list[str]]:
    """The parts of "the red one and the blue one"; "between A and B" and colors stay together."""
    parts, start, between = [], 0, False
    for at, word in enumerate(words):
        between |= word == "between"
        if word not in ("and", "plus") or not words[at + 1 :]:
            continue
        after = words[at + 1]
        known = KNOWN.get(after, "subject") != "subject"
        if between:
            between = False
        elif known or after in ("the", "a", "all", "both", "every"):
            parts.append(words[start:at])
            start = at + 1
    return [part for part in (*parts, words[start:]) if part]


def _query(words: list[str]) -> Query:
    for at in range(1, len(words)):
        if (used := len(_begins(words[at:], EXCEPT).split())) and at + used < len(words):
            left_out = tuple(map(_query, _listed(words[at + used :])))
            return replace(_query(words[:at]), excluded=left_out)
    query, at = Query(), 0
    while at < len(words):
        at += _step(query, words[at:])
    last = query.nouns[-1] if query.nouns else ""
    query.plural |= last == "stuff" or (last.endswith("s") and not last.endswith(("ss", "us")))
    return query


def _begins(words: list[str], forms: dict[str, str]) -> str:
    """The longest of the forms that the words begin with; "" for none."""
    return max((f for f in forms if words[: len(f.split())] == f.split()), key=len, default="")


def _step(query: Query, words: list[str]) -> int:
    """Read what the words begin with into the query; the number of words that it took."""
    word = words[0]
    if word in ("not", "no", "non") and (found := longest(words[1:])):
        query.other_than += (found[1],)
        return 1 + found[0]
    if used := _relation(query, words) or _ranked(query, words):
        return used
    if word in KNOWN:
        if query.kind == "object" or KNOWN[word] != "subject":
            query.kind, query.plural = KNOWN[word], query.plural or word.endswith("s")
    elif word in COUNTS:
        query.plural, query.count = True, COUNTS[word]
    elif word in SIZES:
        query.size, query.upright = SIZES[word], word in UPRIGHT
    elif word in SKIPPED or (word in ("and", "with", "in", "at", "to", "from") and words[1:]):
        pass
    elif found := longest(words):
        query.colors += (found[1],)
        return found[0]
    else:
        query.nouns.append(word)
    return 1


def _relation(query: Query, words: list[str]) -> int:
    """Read a relation and all that follows it; 0 where the words begin with none."""
    form = _begins(words[:-1], RELATIONS)
    relation, rest = RELATIONS.get(form), words[len(form.split()) :]
    told = [word for word in rest if word not in SKIPPED]
    if relation is None or form == "nearest" or (relation == "on" and told and _side(rest)):
        return 0
    if relation == "beside" and not told:
        query.order = "front"  # "nearest to the camera"
        return len(words)
    split = rest.index("and") if relation == "between" and "and" in rest else None
    ends = [rest] if split is None else [rest[:split], rest[split + 1 :]]
    query.relations += ((relation, tuple(_query(each) for each in ends if each)),)
    return len(words)


def _side(words: list[str]) -> tuple[int, str] | None:
    """(words used, side) of "the left", "left side", "the very back"."""
    for at, word in enumerate(words[:3]):
        if word in SIDES:
            after = words[at + 1 : at + 2]
            return at + 1 + (after in (["side"], ["end"], ["edge"])), SIDES[word]
        if word not in ("the", "very", "far", "its"):
            return None
    return None


def _ranked(query: Query, words: list[str]) -> int:
    """Read a superlative, an ordinal or a side; 0 where the words begin with none."""
    word = words[0]
    if word in MOST:
        key, place = MOST[word]
        if query.place and query.order is None:  # "second largest"
            place = query.place if place == 0 else place - query.place
        query.order, query.place = key, place
        return 1
    if word in ORDINALS:
        query.place = ORDINALS[word]
        return 1
    led = word in ("from", "on", "at", "in", "to")
    side = _side(words[1:]) if led else (0, SIDES[word]) if word in SIDES else None
    if side is None or words[1 + side[0] : 2 + side[0]] == ["of"]:
        return 0
    query.order = side[1]
    return 1 + side[0]
