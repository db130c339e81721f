"""Clauses of a sentence, and what a negation in each of them governs.

One rule holds everywhere. A negation governs what follows it in its clause; where nothing that is
known follows, it governs all of its clause. What it governs is never done: it is a part that stays
as it is (a limit), a tone of too little or too much (its sign is turned), or it is left out.
A negation that is none of these voids the sentence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from gsedit.words import lexicon
from gsedit.words.instruction import Change, Target
from gsedit.words.refusals import Refused
from gsedit.words.scan import DETERMINERS, MANNERS, Word

TONES = frozenset(("noun", "state", "turn", "style", "hue"))
CONTENT = TONES | {"color", "material", "light", "look", "finish"}
"""Kinds that name what changes."""
TARGETS = frozenset(("subject", "background", "ground", "place", "scene", "rest"))
"""Kinds that name a part of the scene."""
EMPTY = ("no", "without")
SHADOWS = ("shadow", "shadows")
SOFT = Word("cloudy", "light", "cloudy")
"""Light that casts no shadows."""
IDLE = TARGETS | {"unknown", "part", "shape", "state"}
"""Kinds that a comparison only brings up."""
BECOMES = frozenset(
    ("to", "into", "becomes", "become", "turns to", "turns into", "turn to", "turn into")
)
"""Words between what was and what is to be: "night to day"."""
NEGATIONS = frozenset(("not", "drop"))
NAMED = frozenset(("color", "material", "light", "look"))


@dataclass
class Clause:
    """Words between two marks or conjunctions, by what is to be done with them."""

    before: str = ""
    """Mark or conjunction before it; "" for the first."""
    words: list[Word] = field(default_factory=list)
    """Words of what is asked for."""
    denied: list[Word] = field(default_factory=list)
    """Names of what must not be."""
    limits: list[Word] = field(default_factory=list)
    """Parts that stay as they are."""
    turned: int = 0
    """Sign that a negation gives to a quality: -1 not so bright, +1 not bright enough; 0 none."""
    lost: bool = False
    """Whether a quality is taken away: less of it."""
    void: bool = False
    """Whether a negation says nothing that can be heeded."""
    removed: bool = False
    """Whether an object is to be removed."""
    opens: Word | None = None
    """Negation that goes on into a clause without a verb."""

    def kinds(self) -> set[str]:
        """Kinds of the words that are asked for."""
        return {word.kind for word in self.words}

    def tags(self) -> set[str]:
        """Tags of the words that are asked for."""
        return {tag for word in self.words for tag in word.tags}


def clauses(words: list[Word]) -> list[Clause]:
    """Clauses of a sentence in order, each with what its negations govern."""
    found, opens = list[Clause](), None
    for before, part in _segments(words):
        kept = found and found[-1].limits and not before.endswith(":")
        heir = opens if _inherits(before, part) and not kept else None
        if words[0].text == "not" and before == "," and part[0].text in ("a", "an"):
            heir = None  # "not a watercolor, an oil painting"
        clause = _governed(before, _told(_became(part)), heir)
        opens = clause.opens
        if found and before == "and" and not clause.kinds() & {"do", "wish", "be", "turn"}:
            cures = [word for word in found[-1].words if word.has("cure")]
            clause.words = [*cures, *clause.words]  # "fix the low contrast and the dull colors"
        if found and _goes_on(found[-1], clause):
            clause.words = [*found[-1].words, *clause.words]
            found[-1].words = []
        found.append(clause)
    return found


def _goes_on(noun: Clause, clause: Clause) -> bool:
    """Whether a tone is said before what becomes of it: "contrast and saturation up"."""
    kinds, before = clause.kinds(), noun.kinds()
    said = kinds & {"up", "down", "number", "factor", "fraction", "intense"}
    named = "noun" in before and before <= {"fill", "noun", "be", "unknown", *TARGETS}
    listed = clause.before in ("and", ",") and not before & {"be", "unknown"}
    return named and bool(said) and (listed if "noun" in kinds else not kinds & CONTENT)


def _segments(words: list[Word]) -> Iterator[tuple[str, list[Word]]]:
    """(mark or conjunction before, words) of each clause."""
    before, part, compared = "", list[Word](), False
    for word, after in zip(words, [*words[1:], Word("", "mark", "")]):
        splits = word.kind in ("mark", "conj", "or")
        if part and (word.kind == "retract" or _contrasts(part, word)):
            yield before, part
            before, part = "and", []
        if word.text == ":" and after.kind == "number":
            continue  # "contrast: +10 %"
        if splits and not (compared and word.kind == "conj"):
            if part:
                yield before, part
                before = ""
            before, part, compared = before + word.text, [], False
        else:
            part.append(word)
            compared |= word.kind == "asif"
    if part:
        yield before, part


def _contrasts(part: list[Word], word: Word) -> bool:
    """Whether another direction begins in a clause: "less red more green"."""
    said = {each.text for each in part} & {"more", "less"}
    other = bool(said) and word.text in {"more", "less"} - said and part[-1].kind not in NEGATIONS
    return other and any(each.kind in CONTENT for each in part)


def _inherits(before: str, part: list[Word]) -> bool:
    """Whether a negation goes on into a clause: "not red or blue", "not this: make it night"."""
    own = {"retract", "do", "wish", "touch", "up", "down", "keep", "be", *NEGATIONS}
    if not any(word.kind in CONTENT or word.kind in TARGETS for word in part):
        return False
    own_way = ("just", "only", "instead", "rather")
    bare = not any(word.kind in own or word.text in own_way for word in part)
    return before.endswith(("or", "nor", ":")) or (bare and before in ("and", ","))


def _became(part: list[Word]) -> list[Word]:
    """Words without the name of what gives way: "turn night into day", "paint the red car blue"."""
    names = [at for at, word in enumerate(part) if word.kind in NAMED]
    if len(names) < 2:
        return part
    swaps = any(word.text in ("swap", "switch", "exchange", "replace") for word in part[: names[0]])
    verbs = swaps or any(word.kind in ("do", "wish", "touch") for word in part[: names[0]])
    between = [word.text for word in part[names[0] + 1 : names[1]]]
    if not verbs and " ".join(between) not in BECOMES:
        return part
    first, last = names[0], names[-1]
    between = part[first + 1 : last + 1]
    led = any(
        word.text in ("into", "to", "becomes", "become", *(("for", "with", "by") * swaps))
        for word in between
    )
    of_part = between[0].kind in TARGETS or between[0].kind == "unknown"
    kinds = {part[first].kind, part[last].kind}
    same = len(names) == 2 and (kinds <= {"color", "material"} or kinds == {"light"})
    gives_way = led or (of_part and same and not any(word.text == "with" for word in between))
    return [word for at, word in enumerate(part) if at != first or not gives_way]


def _told(part: list[Word]) -> list[Word]:
    """Words without what a comparison only brings up: after "like" nothing is a part or a thing,
    after "as if" only the first name counts, after "red as" none does."""
    kept, mode, named = list[Word](), "", False
    for word in part:
        last = kept[-1].kind if kept else ""
        if word.kind == "simile" and last == "color":
            mode = "than"  # "white like snow"
        elif word.kind in ("simile", "asif") or (word.text == "if" and mode == "simile"):
            mode = "" if word.text == "if" else word.kind
        elif word.text == "as" and last in ("state", "color", "material"):
            mode = "than"
        elif word.kind == "than":
            mode = "than"
            kept.append(word)
        elif mode and word.kind in (*IDLE, *(CONTENT if mode == "than" else ())):
            continue
        elif mode == "asif" and word.kind in CONTENT:
            kept += [] if named and last not in CONTENT else [word]
            named = True
        else:
            kept.append(word)
    return kept


def _governed(before: str, part: list[Word], heir: Word | None) -> Clause:
    """A clause of these words; `heir` is the negation of the clause before that goes on here."""
    clause, scope, by, excepted = Clause(before), list[Word](), heir, False
    negations = [heir] if heir else []
    for word in part:
        if word.kind in NEGATIONS:
            by = word
            negations.append(word)
        elif word.kind == "except":
            excepted = True
        elif excepted and word.kind in (*TARGETS, *CONTENT, "unknown"):
            (clause.denied if word.kind in CONTENT else clause.limits).append(word)
            excepted = False
        elif by and word.kind == "do" and any(each.kind in CONTENT for each in scope):
            by = None
            clause.words.append(word)
        else:
            (scope if by else clause.words).append(word)
    if clause.denied and clause.kinds() & CONTENT:
        clause.void = True  # "grayscale except the red": no route keeps a color
    if any(word.kind in ("keep", "limit", "same") for word in (*clause.words, *scope)):
        return _kept(clause, scope, len(negations))
    if negations:
        _deny(clause, scope, negations)
    return clause


def _kept(clause: Clause, scope: list[Word], count: int) -> Clause:
    """A clause about what stays as it is."""
    if not count and any(word.kind == "limit" for word in clause.words):
        return replace(clause, limits=[*clause.limits, Word("rest", "rest", "rest")])
    limits = [word for word in (*clause.words, *scope) if word.kind in TARGETS]
    return replace(clause, words=[], limits=[] if count else [*clause.limits, *limits])


def _deny(clause: Clause, scope: list[Word], negations: list[Word]) -> None:
    """Say in the clause what its negations govern."""
    by = negations[0]
    kinds = {word.kind for word in scope}
    named, told = kinds & CONTENT, {word.kind for word in clause.words} & CONTENT
    if len(negations) > 1 and any(each.kind == "drop" for each in negations):
        clause.denied += [word for word in (*scope, *clause.words) if word.kind in CONTENT]
        clause.words, clause.void = [], not clause.denied
    elif (by.kind == "drop" or by.text in EMPTY) and not named | told and _shadows(scope):
        plain = [word for word in scope if word.kind != "intense"]  # "no harsh shadows"
        clause.words = [*clause.words, *plain, SOFT]
    elif by.kind == "drop" or (by.text in EMPTY and _tinted(scope, named, told)):
        _drop(clause, scope, named, told)
    elif sign := _turn(clause, scope, by):
        clause.turned, clause.words = sign, [*clause.words, *scope]
    elif named:
        clause.denied += [word for word in scope if word.kind in CONTENT]
        clause.opens = by
    elif kinds & TARGETS and not kinds & {"part", "shape"}:
        clause.limits += [word for word in scope if word.kind in TARGETS]
        clause.opens = by
    else:
        known = kinds & {"unknown", "part", "shape"}
        clause.denied += [word for word in clause.words if word.kind in CONTENT]
        clause.void = not clause.denied and not known and bool(clause.before)
        clause.words, clause.opens = [], by


def _shadows(scope: list[Word]) -> bool:
    """Whether what there must not be is shadows, and not those of a thing."""
    at = next((at for at, word in enumerate(scope) if word.text in SHADOWS), None)
    loose = ("fill", "intense", "degree")
    of = at is not None and [word.text for word in scope[at + 1 : at + 2]] == ["of"]
    return at is not None and not of and all(word.kind in loose for word in scope[:at])


def _tinted(scope: list[Word], named: set[str], told: set[str]) -> bool:
    """Whether what there must not be is color itself or a tint: "no blue tint"."""
    nouns = {word.value for word in scope if word.kind == "noun"}
    at = next((at for at, word in enumerate(scope) if word.kind == "noun"), 0)
    moved = any(word.kind not in ("fill", "degree") for word in scope[:at])  # "no more color"
    color = named == {"noun"} and nouns == {"saturation"} and not moved
    return color or (named == {"noun", "color"} and nouns == {"hue"} and not told)


def _drop(clause: Clause, scope: list[Word], named: set[str], told: set[str]) -> None:
    """Say what is taken away: a tone, which is then less, or a thing."""
    kinds = {word.kind for word in (*scope, *clause.words)}
    cast = "noun" in kinds and not kinds & {"light", "look", "material"}
    if (cast or (named and named <= {"noun", "state"})) and "down" not in kinds:
        clause.lost, clause.words = True, [*clause.words, *scope]
    elif named & {"material", "look"} and _taken_off(scope):
        clause.removed = True  # "remove the ice from the bear"
    elif named or told:
        clause.denied += [word for word in (*scope, *clause.words) if word.kind in CONTENT]
        clause.words, clause.opens = [], Word("remove", "drop", "")
    else:
        clause.words, clause.removed = [], True


def _taken_off(scope: list[Word]) -> bool:
    """Whether something is to go from a thing, and not from the picture."""
    at = next((at for at, word in enumerate(scope) if word.text in ("from", "off")), len(scope))
    return any(word.kind in ("subject", "unknown") for word in scope[at:])


def _turn(clause: Clause, scope: list[Word], by: Word) -> int:
    """Sign that a negation gives to a quality; 0 where it forbids it or is not plain."""
    kinds = [word.kind for word in scope]
    graded = ("state", "intense", "color")
    if not any(kind in graded for kind in kinds):
        return 0
    if "enough" in kinds:
        return 1
    at = next(i for i, kind in enumerate(kinds) if kind in graded)
    told = {word.text for word in scope[:at] if word.kind == "degree"}
    before = {word.kind for word in clause.words}
    verbs = {"wish", "do", "touch"} & {*kinds[:at], *before}
    if "be" in before and by.text == "not" and not verbs and kinds[at] != "color":
        return 0 if told & {"too", "so", "overly"} else 1
    return -1 if told - {"very", "really", "particularly", "especially"} else 0


# ---- the part of the scene that a clause speaks of, and clauses about what no route does ---------

PARTS: dict[str, Target] = {
    "subject": "subject", "background": "background", "ground": "background",
}  # fmt: skip
HUNG = frozenset(("put", "add", "place", "attach", "hang", "stick", "adding", "bring"))
"""Verbs after which a painting is a thing."""
MOST_UNKNOWN = {"paint": 1, "material": 1, "tone": 2, "light": 3, "look": 3}
"""Words that are not known, beside the name of a change that no verb or part goes with."""


Parts = list[tuple[int, str]]
"""Kinds of parts with their places in a clause."""


def named_parts(clause: Clause) -> Parts:
    """(place in the clause, kind of part) of each part that is named, in order."""
    words, found = clause.words, Parts()
    behind = light = False
    for at, word in enumerate(words):
        behind |= word.kind == "behind"
        light |= word.kind == "light"
        pointed = light and any(each.kind == "direction" for each in words[max(at - 3, 0) : at])
        cast = light and behind and not any(w.value in ("fog", "cloudy", "storm") for w in words)
        verb = word.text == "render" and any(w.text in DETERMINERS for w in words[at + 1 : at + 3])
        if word.kind in TARGETS and not (pointed or cast or verb):
            found.append((at, "background" if behind and word.kind == "subject" else word.kind))
            behind = False
        elif word.kind == "unknown" and is_thing(words, at) and not pointed:
            found.append((at, "background" if behind else "subject"))
    around = [kind for _, kind in found] == ["scene", "background"]
    return found[around:]  # "everything around the bear"


def is_thing(words: list[Word], at: int) -> bool:
    """Whether an unknown word is the name of what changes: "the fox", "gold sofa"."""
    if at and words[at - 1].kind in ("color", "material", "finish"):
        return True
    before = [
        word for word in words[:at] if word.kind not in ("color", "material", "finish", "state")
    ]
    return bool(before) and before[-1].text in DETERMINERS


def part_of(kind: str, change: Change) -> Target:
    """Part that a change of a clause about such a part changes."""
    if kind == "place":
        return "background" if change.kind in ("paint", "material") else "scene"
    return PARTS.get(kind, "scene")


def refuse_parts(clause: Clause) -> None:
    """Raise Refused for a clause about shape, an object, or a part that nothing finds."""
    words, kinds = clause.words, clause.kinds()
    scenic = kinds & {"light", "look"}
    if "shape" in kinds and not scenic and not kinds & {"noun", "hue"}:
        raise Refused("geometry")
    sided = any(word.value in ("from the left", "from the right") for word in words)
    asked = kinds & {"do", *TARGETS} and kinds & CONTENT
    if sided and not scenic and asked and not any(w.value == "light" for w in words):
        raise Refused("part")
    drawn = any(word.kind == "look" and word.value in lexicon.styles() for word in words)
    if any(word.text == "sky" for word in words) and (drawn or ("color" in kinds and not scenic)):
        raise Refused("part")
    if "part" in kinds and not scenic and kinds & {"do", "act", "wish", *CONTENT}:
        raise Refused("part")
    for at, word in enumerate(words):
        alone = not any(each.kind in ("unknown", *TARGETS) for each in words[at + 1 : at + 3])
        if word.kind == "material" and at and words[at - 1].text in DETERMINERS and alone:
            raise Refused("part")  # "the rock" is a thing
    if any(_hung(words, at) for at, word in enumerate(words) if word.value in lexicon.styles()):
        raise Refused("geometry")
    if "act" in clause.tags() and not (scenic or kinds & {"noun", "turn", "style"}):
        _refuse_objects(words)


def _hung(words: list[Word], at: int) -> bool:
    """Whether a picture or a poster is a thing to be put somewhere: "hang a poster on the wall"."""
    verb, article = [word.text for word in words[max(at - 2, 0) : at]] if at > 1 else ("", "")
    after = words[at + 1].text if at + 1 < len(words) else ""
    return verb in HUNG and article in ("a", "an", "some", "another") and after not in MANNERS


def _refuse_objects(words: list[Word]) -> None:
    """Raise Refused where an object would be added: "put a hat on it", "add a rose"."""
    verb = next(word.text for word in words if word.has("act"))
    for at, word in enumerate(words):
        new = at > 0 and words[at - 1].text in ("a", "an", "some", "another")
        plain = word.kind == "unknown" and not (at and words[at - 1].text in DETERMINERS)
        thing = word.kind == "subject" or (word.kind == "color" and " " not in word.text)
        if plain or (new and thing and verb != "give"):
            raise Refused("geometry")


def refuse_idle(clause: Clause, changes: list[Change]) -> None:
    """Raise Refused for a change that stands among words which nothing explains."""
    words = clause.words
    unknown = [
        at for at, word in enumerate(words) if word.kind == "unknown" and not is_thing(words, at)
    ]
    asked = clause.kinds() & {"do", "wish", "up", "down", *TARGETS}
    most = MOST_UNKNOWN[changes[0].kind] + (2 if asked else 0)
    if len(unknown) > most:
        raise Refused("nonsense")
