"""Noun phrases of a sentence: each is replaced by a word of its own, and is what it was afterwards.

"Paint the lid of the jar red" is "paint the zqax red". Who reads the rest needs to know no noun,
and two nouns are never one. Loads no torch.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

from gsedit.words.instruction import Change
from gsedit.words.lexicon import SLOTS, rows_of, things
from gsedit.words.phrases import IT
from gsedit.words.scan import DETERMINERS, STAND_IN, Word, scanned

DEFINITE = DETERMINERS | {"these", "those", "its", "both", "all", "every", "each"}
"""Words that a noun phrase begins with."""
HEADS = frozenset(("unknown", "subject", "ground", "part"))
"""Kinds of words that are nouns."""
MODIFIERS = HEADS | {"color", "material", "finish", "direction", "place", "number"}
"""Kinds of words that may stand before a noun."""
ONES = frozenset(things("ones"))
"""Nouns that the lexicon has as other words."""
SIZES = frozenset(things("telling")) | frozenset(things("adjective"))
"""Adjectives that the lexicon has as other words."""
OPINIONS = frozenset(things("opinion"))
"""Adjectives that tell no thing from another: "that ugly old pot"."""
NO_NOUNS = frozenset(things("nothing")) | frozenset(things("loose")) | frozenset(things("filler"))
NO_NOUNS -= {"face", "faces", "head", "foreground"}
"""Words that are no things, whatever stands before them."""
VERBS = [word for kind, _, row in rows_of(SLOTS) if kind == "verb" for word in row]
OTHERS = (
    frozenset(things("other"))
    | frozenset(things("over"))
    | {word for each in VERBS for word in each.split()[:1]}
)
"""Words that are no things where they have no article."""
RELATIONS = re.compile(
    r"(?:to the|on the|at the|in the)? ?(?:left|right|front|top|bottom|back|edge|middle|center)?"
    r" ?(?:side )?(?:of|next to|in front of|on top of|beside|near|behind|under|underneath|above"
    r"|below|by|on|in|at|inside|around|between|along|with|from)"
)
WHERE = re.compile(
    r"(?:on|at|in) the (?:far )?(?:left|right|back|front|middle|center|top|bottom|rear"
    r"|corner|background|foreground|distance)(?: (?:side|hand side|corner|edge))?"
    r"|behind|upstairs"
)
BEFORE = r"\b(the|this|that|these|those|my|our|your|its|their)\s+"
"""Words after which a saved name is one: "make it gold" is no call of what was saved as gold."""
WRITTEN = re.compile(r"[_-]|[a-z]\w*\d", re.IGNORECASE)
"""A sign that a name is written as it was saved, "left_leg-2": it needs no word before it."""


@dataclass
class Nouns:
    """Phrases by the words that stand in for them."""

    phrases: dict[str, str] = field(default_factory=dict)

    def stand_in(self, phrase: str) -> str:
        """The word that stands in for a phrase, "zqax"; one for a phrase said twice."""
        for word, each in self.phrases.items():
            if each == phrase:
                return word
        number = len(self.phrases)
        word = f"zq{chr(97 + number // 26)}{chr(97 + number % 26)}x"
        self.phrases[word] = phrase
        return word

    def restored(self, text: str) -> str:
        """A text with the phrases again."""
        return re.sub(rf"(?:the )?({STAND_IN})", lambda m: self.phrases.get(m[1], m[0]), text)

    def told(self, change: Change) -> Change:
        """A change with the phrases again; "the subject" says no more than its target."""
        phrase = self.restored(change.phrase)
        if phrase == "the subject":
            phrase = IT if change.kind == "object" else ""
        place = change.place and replace(change.place, of=self.restored(change.place.of))
        keep = tuple(map(self.restored, change.keep))
        return replace(change, phrase=phrase, place=place, keep=keep)


def tells(phrase: str) -> bool:
    """Whether a phrase has a color, a size or a place that tells a thing from others."""
    words = scanned(phrase)
    sized = set(" ".join(word.text for word in words).split()) & {
        *things("telling"),
        "one",
        "thing",
    }
    return bool(sized) or any(word.kind in ("color", "direction") for word in words)


def called(sentence: str, saved: Collection[str], nouns: Nouns) -> str:
    """The sentence with stand-ins for the names of saved selections; these win over all words."""
    if not saved:
        return sentence
    longest_first = sorted(saved, key=lambda name: (-len(name), name))
    any_name = "|".join(re.escape(name).replace(r"\ ", r"[\s_-]+") for name in longest_first)
    pattern = re.compile(rf"(?:{BEFORE})?(?<![\w-])({any_name})(?![\w-]|\.\w)", re.IGNORECASE)

    def put(match: re.Match[str]) -> str:
        if match[1] is None and not WRITTEN.search(match[2]):
            return match[0]
        name = re.sub(r"[\s_-]+", " ", match[2].lower())
        owner = (match[1] or "the").lower()
        return f"the {nouns.stand_in(f'{owner} {name}')}"

    return pattern.sub(put, sentence)


def chunked(words: Sequence[Word], nouns: Nouns) -> str:
    """The text of words with stand-ins for noun phrases."""
    out, at = list[str](), 0
    while at < len(words):
        start, end = _phrase(words, at)
        if end:
            phrase = " ".join(w.text for w in words[start:end] if w.text not in OPINIONS)
            phrase = phrase.replace(" 's", "'s")
            out += (word.text for word in words[at:start])
            out += ["the"] * (out[-1:] != ["the"])
            out.append(nouns.stand_in(nouns.restored(phrase)))
            at = end
        else:
            after = max(at + 1, start)
            out += (word.text for word in words[at:after])
            at = after
    return " ".join(out)


PLACING = frozenset(
    ("move", "put", "place", "shift", "slide", "copy", "clone", "duplicate", "insert", "push",
     "pull", "bring", "drag", "stick", "nudge", "scoot", "set", "relocate", "drop", "hang", "take",
     "dupe", "second", "another", "more", "extra")
)  # fmt: skip
"""Verbs after which a place is where something goes, not where it is."""
ENDS = frozenset(("mark", "conj", "or"))


def _phrase(words: Sequence[Word], at: int) -> tuple[int, int]:
    """(start, end) of the noun phrase that begins at a word; (next word, 0) for none."""
    word = words[at]
    if STAND_IN_WORD.fullmatch(word.text):
        return at, _related(words, at, at + 1)
    if word.text in ("a", "an"):
        return _value_end(words, at + 1), 0
    if word.text in DEFINITE:
        head = _head(words, at + 1, len(words) > at + 1 and word.text in ("the", "this", "that"))
        head = head or _held(words, at)
        return (at, _related(words, at, head)) if head else (at + 1, 0)
    if word.kind not in HEADS or word.text in NO_NOUNS or word.text[0] == "<":
        return at + 1, 0
    end = at
    while end < len(words) and (words[end].kind in HEADS or words[end].kind == "poss"):
        if words[end].text in NO_NOUNS or words[end].text in OTHERS:
            break
        end += 1
    if end == at:
        return at + 1, 0
    run = words[at:end]
    if len(run) > 2 and all(each.kind == "unknown" for each in run):
        return end, 0
    if all(each.kind in ("unknown", "poss") for each in run) and not _names_thing(words, at, end):
        return end, 0
    return _start(words, at), _related(words, at, end)


def _held(words: Sequence[Word], at: int) -> int:
    """End of what stays, whatever its words mean: "leave the candles", "the corks stay"; or 0."""
    before = words[at - 1] if at else Word("", "mark", "")
    ends = (*ENDS, "keep", "same", "be", "limit", "wish")
    end = next((i for i in range(at + 1, len(words)) if words[i].kind in ends), len(words))
    after = words[end].kind if end < len(words) else "mark"
    led = before.kind in ("keep", "except", "touch") or before.text in ("without", "not", "touch")
    short = 0 < end - at - 1 <= 3 and words[end - 1].kind not in (
        "background",
        "rest",
        "scene",
        "noun",
        "place",
    )
    return end if short and ((led and after in ENDS) or after in ("keep", "same")) else 0


def _value_end(words: Sequence[Word], at: int) -> int:
    """End of what stands after "a": something that is made, no thing of the scene."""
    while at < len(words) and (words[at].kind in MODIFIERS or words[at].has("adj")):
        at += 1
    return at


def _head(words: Sequence[Word], at: int, plain: bool) -> int:
    """End of a noun phrase whose determiner stands before a word; 0 for none."""
    start, head = at, 0
    while at < len(words):
        word = words[at]
        noun = word.kind in HEADS or (
            word.text in ONES and (head or word.text not in ("frame", "frames"))
        )
        if (
            word.text in NO_NOUNS
            or (head and word.text in OTHERS)
            or STAND_IN_WORD.fullmatch(word.text)
        ):
            break
        if noun:
            head = at + 1
        elif not (
            word.kind in MODIFIERS
            or word.kind == "poss"
            or word.has("adj")
            or word.text in SIZES
            or word.text in OPINIONS
        ):
            break
        at += 1
    return head or _headless(words, start, plain and at == start + 1)


def _headless(words: Sequence[Word], start: int, plain: bool) -> int:
    """End of a phrase without a noun of the lexicon: "the roses are", "the largest"; 0 for none."""
    if start >= len(words):
        return 0
    first = words[start]
    plural = first.text[-1:] == "s" and first.text[-2:-1] not in ("s", "u", "i")
    follows = words[start + 1] if start + 1 < len(words) else Word("", "mark", "")
    told = follows.kind in ("be", "wish", "keep", "same") or follows.text in ("does", "do")
    solid = first.kind in ("material", "look", "light")
    if told and (solid or first.kind == "finish") and len(words) > start + 2:
        return start + 1
    if plural and solid and first.text != "lights":
        return start + 1
    if plain and first.kind == "material":
        before = words[start - 2].text if start > 1 else ""
        dropped = any(word.kind == "drop" for word in words[:start])
        noun = first.text == first.value and not dropped
        return (start + 1) * (noun and before not in ("into", "of", "from", "in", "like", "with"))
    return (start + 1) * (first.text in RANKED)


RANKED = frozenset(each for each in things("telling") if each.endswith("est")) | {"last", "first"}
"""Words that are a noun phrase with "the" alone: "the largest"."""
STAND_IN_WORD = re.compile(STAND_IN)


def _names_thing(words: Sequence[Word], at: int, end: int) -> bool:
    """Whether words that nobody knows, without an article, are a thing by where they stand."""
    before = words[at - 1] if at else Word("", "mark", "")
    after = words[end] if end < len(words) else Word("", "mark", "")
    if after.text in DEFINITE or after.text in ("a", "an", "it") or before.text in ("a", "an"):
        return False
    if before.kind in ("simile", "asif", "than") or before.text in ("as", "like"):
        return False
    if any(word.text in OTHERS for word in words[at:end]):
        return False
    alone = before.kind in ENDS and after.kind in ENDS
    valued = before.text in ("in", "into", "of", "as", "to", "with", "from", "the")
    named = at > 1 and any(STAND_IN_WORD.fullmatch(w.text) or w.kind in HEADS for w in words[:at])
    return not alone and not (valued and named)


def _start(words: Sequence[Word], at: int) -> int:
    """Start of a noun phrase without an article: its color belongs to it where another follows."""
    kinds, start = ("color", "material", "finish"), at
    end = next((i for i in range(at, len(words)) if words[i].kind in ENDS), len(words))
    other = any(word.kind in kinds for word in words[at:end])
    while other and start and words[start - 1].kind in kinds:
        start -= 1
    while start and (words[start - 1].text in SIZES or words[start - 1].kind == "direction"):
        if words[start - 1].text.endswith("er") or words[start - 1].text in (
            "big",
            "huge",
            "giant",
        ):
            break
        start -= 1
    return start


def _related(words: Sequence[Word], at: int, end: int) -> int:
    """End of a noun phrase with what tells where it is, or of what it is a part."""
    first = next((i for i in range(at - 1, -1, -1) if words[i].kind in ENDS), -1) + 1
    placed = any(PLACING & set(word.text.split()) for word in words[first:at])
    for count in range(min(5, len(words) - end), 0, -1):
        if any(word.kind in ENDS for word in words[end : end + count]):
            continue
        text = " ".join(word.text for word in words[end : end + count])
        after = end + count
        if RELATIONS.fullmatch(text.strip()) and (text == "of" or not placed):
            if after < len(words) and words[after].text in DEFINITE:
                if head := _head(words, after + 1, True):
                    return _related(words, after, head)
            elif after < len(words) and words[after].kind in ("subject", "ground"):
                return after + 1
        if not placed and WHERE.fullmatch(text):
            return after
    return end
