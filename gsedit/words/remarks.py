"""Remarks beside what is asked: reasons, feelings, what somebody sees. Loads no torch."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gsedit.words.scan import STAND_IN, scanned

SPLIT = re.compile(
    r"(?<!\S)(?:[,;.!?:\n]|and|but|or|because|since|so that|so(?= (?:i|it|he|she|we|they|you|"
    r"people|everyone|my|this|that)\b)|as(?= (?:i|it|we|they|he|she|my|you)\b)|cause|cuz|cos|"
    r"coz|though|although|while|when)(?!\S)"
)
WHO = (
    rf"(?:it|he|she|they|this|that|these|those|there|i|we|you|my [a-z]+|our [a-z]+|everyone|"
    rf"everybody|people|the ({STAND_IN})|the (?:picture|photo|scene|image|whole thing|"
    rf"colors?|light|lighting|sky|contrast|shadows|whites)|which|who|what|nobody|somebody)"
)
REMARK = re.compile(
    rf"(?:and |but |so |because |since |as |cause |cuz |cos |though |although |while |when |"
    rf"well |oh |honestly |frankly |sadly |at the moment |right now |now |currently |, )*"
    rf"{WHO} (?:just |really |always |still |all |both |only |simply |also |never |kind of |"
    rf"sort of |kinda |currently )*"
    rf"(?:is|are|am|was|were|be|looks?|feels?|seems?|appears?|has|have|had|got|gets?|came|"
    rf"comes|do|does|did|can|ca|could not|will|would not|love|loves|like|likes|hate|hates|"
    rf"think|thinks|know|knows|remember|miss|find|prefer|saw|see|sees|bought|made|took|"
    rf"photographed|shot|scanned|captured|painted|built|went|live|lived|grew|need not|"
    rf"reminds|makes|hurts|hurt|sits|stands|ruins|spoils|bothers|annoys|distracts|drives|wo|"
    rf"might|may|stopped|stole|gave|belonged|belongs|lost|dries|died|forgot|said|told|mean|"
    rf"promise|swear|guess|suppose|sat|used|pops?|stands out|shows?|sells?)\b"
)
ASKS = re.compile(
    r"\b(?:should|must|want|wants|wish|need|needs|would like|would love|would prefer|would "
    r"be|let|ought|please|has to|have to|is to|are to|supposed to|could be|can be|can we|can "
    r"you|could you|make it|make them)\b|\bsaid\b|\btold\b|\bnot (?:want|like)\b(?! (?:it|"
    r"them|that|this|him|her)\b)"
)


HOLDS = re.compile(
    r"\b(?:keep|keeps|kept|leave|stay|stays|staying|remain|remains|same|clear|clean|dry|real|"
    r"normal|untouched|spare|except|only|without|still want|still see|visible|alone|as is|"
    r"unchanged)\b"
)
"""Words of what stays: a clause with a thing and one of them is no remark."""
NAMED = {"look", "light", "material", "noun", "hue"}
"""Kinds of what "it" may be after a remark: no thing."""
FEELING = re.compile(
    r"(?:i|we|he|she|nobody|they|it|that|this) (?:really |just |never |do not |does not )"
    r"*(?:like|liked|likes|need|needs|want|wants|annoys|bothers|bugs|hates|hate) (?:it|them|"
    r"that|this|him|her|me|us)(?: [a-z]+)?"
    r"|(?:that|it|this) would be (?:great|nice|lovely|good|perfect|wonderful|awesome|cool|"
    r"fine|amazing|super)(?: [a-z]+)?"
)
"""A feeling of somebody."""
RUN_ON = re.compile(
    r"(?<=[a-z%0-9])(?<!make)(?<!making)(?<!let)(?<!have)(?<!want)(?<!see)(?<!get)(?<!keep)"
    r"(?<!if)(?<!that)(?<!when)(?<!as)(?<!though)(?<!so)(?<!because)(?<!like)(?<!where)"
    r"(?<!what)(?<!how)(?<!than)(?<!since)(?<!until)(?<!should)(?<!could)(?<!can)(?<!may)"
    r"(?<!does)(?<!do)(?<!and)(?<!but)(?<!or) (?:pls |please )?(?=(?:(?:i|we) (?:can|could|"
    r"am|do|did|want|need|like|love|hate|think|have|had|ca|see)|(?:it|he|she|they|its|their) "
    r"(?:is|are|looks?|feels?|seems?|should|ugly|too|way|all|so|really)|(?:can|could|would|"
    r"will) (?:u|you)|make (?:it|them|him|her) (?:look|more|less|a |all)|there is|i m|its "
    r"(?:ugly|too|way|so|really|boring|not)) )"
)
"""The place where another clause begins without a mark."""
LIKENED = re.compile(
    r" as (?:a|an|the) [^,;.!?:\n]*| (?:(?:just |kind of |sort of |a bit |exactly |a little |"
    r"much )?(?:like|as if|as though|as in|similar to|the way|reminiscent of|such as|same as|"
    r"the same as|the kind|the sort|the type|sort of like|you know)) [^,;.!?:\n]*|,? (?:so|"
    r"so that|in order that|that way) (?:i|we|you|it|he|she|they|people|everyone|the [a-z]+) "
    r"[^,;.!?:\n]*| for (?:the|my|our|a|an|this|some) (?!zq)[a-z]+(?: [a-z]+)?(?= ?(?:[,.!?]|"
    r"$))"
)
"""Words that only illustrate a request, or say what it is for."""


def variants(text: str) -> Iterator[str]:
    """Texts to be read instead of a text, the likeliest first: without remarks, as it is, and
    without what only illustrates it."""
    text = RUN_ON.sub(" , ", text)
    for each in without_remarks(text):
        yield each
    for each in without_remarks(text):
        if (bare := LIKENED.sub("", each)) != each and bare.strip(" ,.!?"):
            yield bare


def without_remarks(text: str) -> Iterator[str]:
    """A text without its remarks, and as it is."""
    clauses, start, before = list[tuple[str, str]](), 0, ""
    for match in [*SPLIT.finditer(text), None]:
        end = len(text) if match is None else match.start()
        if part := text[start:end].strip():
            clauses.append((before, part))
            before = ""
        if match is not None:
            before, start = f"{before} {match[0]}".strip(), match.end()
    kept, remark = list[str](), False
    for mark, part in clauses:
        whole = f"{mark} {part}".strip()
        reason = (
            mark.split()[-1:]
            and mark.split()[-1]
            in ("because", "since", "cause", "cuz", "cos", "coz", "so that", "as")
        ) or mark.endswith("so that")
        asif = part.startswith(("as if", "as though")) or (
            mark.endswith("as") and part.startswith(("if", "though"))
        )
        is_remark = (
            (bool(REMARK.match(part)) or bool(reason)) and not ASKS.search(part) and not asif
        )
        held = HOLDS.search(part) or re.search(
            r"\b(?:but|though|although|while|yet|whereas)\b", mark
        )
        is_remark |= bool(FEELING.fullmatch(part))
        is_remark &= not (held and re.search(STAND_IN, part))
        remark |= is_remark
        if not is_remark:
            kept.append(whole if kept else part)
    text_kept = " ".join(kept)
    dropped = " ".join(part for _, part in clauses if part not in text_kept)
    brought = NAMED & {word.kind for word in scanned(dropped)}
    refers = re.search(r"\b(?:it|them|that)\b", text_kept) and not re.search(STAND_IN, text_kept)
    if remark and kept and not (brought and refers and not re.search(STAND_IN, dropped)):
        yield text_kept
    yield text
