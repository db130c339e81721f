"""Reader of a sentence: what is asked, of which things, and what stays. Loads no torch.

Noun phrases become stand-ins (gsedit.words.nouns), frames are cut out (gsedit.words.frames), the
rest is read plainly (gsedit.words.plain), and the whole is checked (gsedit.words.checks). What the
rules refuse for words that they do not know is marked by a network (gsedit.words.marks).
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace

from gsedit.errors import Said
from gsedit.words.actions import FILE
from gsedit.words.checks import meets, stops, unread_in
from gsedit.words.clauses import NEGATIONS
from gsedit.words.frames import NOUN, Frames, framed
from gsedit.words.instruction import MOST, Change, Instruction, sentence_of
from gsedit.words.marks.heard import by_marks, stays_unheard
from gsedit.words.nouns import Nouns, called, chunked, tells
from gsedit.words.phrases import IT, NUMBERED, with_base, without_base
from gsedit.words.plain import plainly
from gsedit.words.refusals import REASONS, Refused, first_refusal, unlike_all
from gsedit.words.remarks import variants
from gsedit.words.scan import scanned
from gsedit.words.written import is_written, written

WEAKER = 0.5
"""Share of its usual amount that a change with a limit gets: "but not too much"."""


DENIED = re.compile(
    r"^(?:please |, )*(?:do not|dont|never|nobody|no one|there is no need|i do not want(?! the zq)"
    r"|i would not|avoid|stop) (?!(?:like|love|forget|hesitate|mind)\b)"
    r"(?!.*\b(?:so|too|as)\b)[^,;.:!?]*$"
)
CONDITION = re.compile(
    r"^(?:if (?:you|we|i) (?!(?:can|could|please|would|want|like|do not|may|wo|will)\b)"
    r"|(?:he|she|they|i) (?:said|says|told|says that) :)"
)
"""A sentence that only denies, tells a condition, or what somebody said."""
NOT_ONLY = re.compile(
    r"\b(?:but|just|instead|rather|only|and|make it (?:lighter|brighter|darker))\b"
)
"""Words after which what is asked follows what is denied."""
REFERS = re.compile(r"\b(?:it|its|them|their|him|his|her|there)\b")
"""Words for what a remark named."""


def read_instruction(
    sentence: str, saved: Collection[str] = (), *, accept_unread: bool = False
) -> Instruction:
    """Changes that a sentence asks for, or why it is refused; checks keep back what it forbids.

    `saved` are names of saved selections, as `gsedit.select.saved.key_of_name` spells them: they
    are things. With `accept_unread` words that nothing was made of do not stop the rest. JSON in
    place of a sentence is taken as it is: see `gsedit.words.written`. A sentence whose words the
    rules do not all know is read by the network, which loads torch. Raises UsageError for JSON that
    is not changes.
    """
    if is_written(sentence):
        return written(sentence)
    if (bare := without_base(sentence)) != sentence:
        read = read_instruction(bare, saved, accept_unread=accept_unread)
        return with_base(read, sentence)
    read = _by_rules(sentence, saved, accept_unread=accept_unread)
    if _calls(sentence, saved) or not (_doubtful if read.known else _unheard)(sentence, read):
        return read
    files = [match[0].strip("\"'") for match in FILE.finditer(sentence)]
    heard = by_marks(sentence, FILE.sub(THING, sentence), files, accept_unread=accept_unread)
    return heard if heard.known or (not read.known and heard.refusal in TOLD) else read


PLAIN = 8
"""Words of a request up to which the rules read it more rightly than the network, where they know
its words: docs/measurements/instructions.md."""
UNHEARD = frozenset(("nonsense", "unread", "geometry", "two", "kept", "question"))
"""Refusals of the rules for words that they do not know."""
SHAPES = re.compile(
    r"\b(?:tall|taller|wider|longer|thinner|slimmer|stretch\w*|bend|bent|news|degrees|noise|grain|"
    r"export|save|print|resolution)\b",
    re.IGNORECASE,
)
"""Words of forms, angles and files, which the network takes for something else."""
DENIES = re.compile(
    r"\b(?:not?|never|without|neither|nor|less|least|fewer|thinner|lighter|half|halve|quarter|stop|"
    r"end|off|out|over|undo|avoid|except|but|if|light|reduce|remove|kill|wipe|un-?\w+|want)\b|n't\b",
    re.IGNORECASE,
)
"""Words that may deny, or take away what no route takes away."""
TOLD = frozenset(("unknown", "insert", "unread"))
"""Refusals of the network that say more than those of the rules."""
THING = "a hat"
"""Words that the network reads in place of a file."""


def _doubtful(sentence: str, read: Instruction) -> bool:
    """Whether the network may know better than the rules: in a long request that the program did
    not write itself, or where what stays was lost. Actions on objects the rules know best."""
    own = sentence in (sentence_of(read.changes), "; ".join(map(str, read.changes)))
    acts = all(change.kind == "object" for change in read.changes)
    asked = framed(chunked(scanned(sentence), Nouns())).asked
    long = not own and not acts and len(asked.split()) > PLAIN
    return long or bool(stays_unheard(sentence, read.changes))


def _unheard(sentence: str, read: Instruction) -> bool:
    """Whether the rules refuse a sentence for words that the network may know."""
    if read.refusal == "negation":
        return not DENIES.search(sentence)
    odd = first_refusal(sentence, scanned(sentence)) not in (None, "question")
    formed = read.refusal in ("geometry", "nonsense", "unread") and SHAPES.search(sentence)
    return read.refusal in UNHEARD and not formed and not odd


def _calls(sentence: str, saved: Collection[str]) -> bool:
    """Whether a sentence has a saved name, or the number of an object."""
    return NUMBERED.search(sentence) is not None or called(sentence, saved, Nouns()) != sentence


def _by_rules(sentence: str, saved: Collection[str], *, accept_unread: bool) -> Instruction:
    """The reading of a lexicon and rules: exact where they know every word."""
    nouns = Nouns()
    try:
        if kind := first_refusal(sentence, scanned(sentence)):
            raise Refused(kind)
        changes, unread = _read(sentence, saved, nouns)
    except Refused as refused:
        kind = refused.args[0]
        if kind == "nonsense" and (why := unlike_all(sentence)):
            return Instruction(sentence, False, why, (), "style")
        return Instruction(sentence, False, REASONS[kind], (), kind)
    told = tuple(map(nouns.told, changes))
    text, left = "; ".join(map(str, told)), tuple(nouns.restored(each) for each in unread)
    if any(map(stops, left)) and not accept_unread:
        quoted = ", ".join(repr(each) for each in left)
        why = Said(f"read: {text}; not read: {quoted}. Run it without?", "unread")
        return Instruction(sentence, False, why, (), "unread", left)
    return Instruction(sentence, True, text, told, unread=left)


def denies(sentence: str) -> bool:
    """Whether a sentence says what must not be or what stays."""
    frames = framed(chunked(scanned(sentence), Nouns()))
    asked = any(word.kind in {*NEGATIONS, "down"} for word in scanned(frames.asked))
    return bool(frames.kept) or asked


def _read(sentence: str, saved: Collection[str], nouns: Nouns) -> tuple[list[Change], list[str]]:
    """(changes, words that are not read) of a sentence, with stand-ins. Raises Refused."""
    text = re.sub(r"[<>]", " ", sentence)
    files = [match[0].strip("\"'") for match in FILE.finditer(text)]
    numbers = iter(range(len(files)))
    text = FILE.sub(lambda _: f" <{next(numbers)}> ", text)
    text = NUMBERED.sub(lambda found: f"the {nouns.stand_in(f'object {found[1]}')}", text)
    frames = framed(chunked(scanned(called(text, saved, nouns)), nouns))
    if not frames.asked.strip(" ,.;:!?") and frames.asked != text:
        raise Refused("negation")
    denied = DENIED.search(frames.asked) and not NOT_ONLY.search(frames.asked)
    if denied or CONDITION.search(frames.asked):
        raise Refused("negation")
    changes, unread = _best(frames)
    changes = _alone(changes, frames, nouns)
    if frames.weaker:
        changes = [_weaker(change) for change in changes]
    if frames.kept:
        changes = [_but(change, frames) for change in changes]
        out = {f"the {each}" for each in frames.left_out if each.startswith("zq")}
        missed = out - {
            p for c in changes for p in (*c.keep, c.phrase if c.target == "background" else "")
        }
        if missed:
            raise Refused("kept", frames.said[0])
    elif any(c.name == "remove" and c.target == "scene" for c in changes):
        raise Refused("everything")
    if any(
        not -1 <= (c.amount or 0) <= MOST.get(c.kind, 0)
        for c in changes
        if c.kind not in ("object", "growth")
    ):
        raise Refused("amount")
    if stopped := meets(frames, changes):
        raise Refused("kept", stopped)
    named = [
        replace(c, phrase=files[int(c.phrase.strip("<>"))]) if c.phrase.startswith("<") else c
        for c in changes
    ]
    return named, unread


def _alone(changes: list[Change], frames: Frames, nouns: Nouns) -> list[Change]:
    """Lights and looks of the one thing that a phrase tells from others: "light the red one"."""
    found = list(dict.fromkeys(NOUN.findall(frames.asked)))
    lit = all(c.target == "scene" and c.kind in ("light", "look") for c in changes)
    if len(found) != 1 or not lit or frames.kept or not tells(nouns.phrases[found[0]]):
        return changes
    return [replace(c, target="subject", phrase=f"the {found[0]}") for c in changes]


def _best(frames: Frames) -> tuple[list[Change], list[str]]:
    """(changes, words that are not read) of what is asked, with remarks or without: the reading
    that leaves the fewest words. Raises Refused."""
    best: tuple[list[Change], list[str]] | None = None
    refused: Refused | None = None
    for text in variants(frames.asked):
        try:
            changes = plainly(text)
        except Refused as error:
            refused = refused or error
            continue
        changes = _corrected(changes, text, frames)
        unread = sorted(unread_in(text, changes), key=stops)
        if best is None or _cost(unread) < _cost(best[1]):
            best = changes, unread
        if not unread:
            break
    if best is None:
        raise refused or Refused("nonsense")
    return best


def _cost(unread: list[str]) -> int:
    """How much is not read: a word that stops the rest counts most."""
    return sum(10 if stops(each) else 1 for each in unread)


def _corrected(changes: list[Change], text: str, frames: Frames) -> list[Change]:
    """Changes of the thing that was named in what was taken back: "the bear red, no, blue"."""
    before = frames.asked[: max(frames.asked.find(text[:16]), 0)]
    said = frames.dropped or (before if REFERS.search(text) else "")
    found = NOUN.findall(said)
    if not found or NOUN.search(text):
        return changes
    phrase = f"the {found[0]}"
    return [
        replace(c, phrase=phrase, target="subject")
        if c.phrase in ("", IT) and c.target != "background" and c.kind not in ("light", "look")
        else c
        for c in changes
    ]


def _weaker(change: Change) -> Change:
    """A change that goes less far, where its amount was not said."""
    if change.kind == "tone" and change.amount:
        return replace(change, amount=round(change.amount * WEAKER, 4))
    if change.kind == "light" and change.amount is None:
        return replace(change, amount=-0.4)
    return change


def _but(change: Change, frames: Frames) -> Change:
    """A change without what stays. Raises Refused where nothing of it is left."""
    if change.name in ("insert", "copy"):
        return change
    phrases = list(dict.fromkeys(f"the {each}" for each in frames.kept if each.startswith("zq")))
    if change.phrase.removeprefix("the ") in frames.left_out:
        return replace(change, keep=())  # "all but the bike gray, and the bike red"
    if change.phrase in phrases:
        raise Refused("kept", frames.said[0])
    explicit = bool(NOUN.search(frames.asked)) or bool(
        re.search(r"\b(?:it|him|her|them)\b", frames.asked)
    )
    if "background" in frames.kept or "rest" in frames.kept:
        if change.target == "background" and not change.phrase and "background" in frames.kept:
            raise Refused("kept", frames.said[0])
        if change.target == "scene":
            change = replace(change, target="subject")
    if "it" in frames.kept:
        if change.target == "subject" and change.phrase in ("", IT) and explicit:
            raise Refused("kept", frames.said[0])
        if change.target in ("scene", "subject") and change.phrase in ("", IT):
            change = replace(change, target="background", phrase="")
    if not phrases:
        return change
    whole = change.target == "scene" or (
        change.target == "subject" and not change.phrase and not explicit
    )
    if whole:
        return replace(change, target="background", phrase=phrases[0], keep=tuple(phrases[1:]))
    return replace(change, keep=tuple(phrases))
