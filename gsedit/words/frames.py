"""Frames of a sentence: what is asked, what stays, how far a change goes, what is taken back, and
remarks. Each is cut out of the text before what is asked is read. Loads no torch.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from gsedit.words.scan import STAND_IN

TABLE = Path(__file__).with_name("frames.txt")
NOUN = re.compile(rf"the ({STAND_IN})")


def _rows() -> list[tuple[str, re.Pattern[str]]]:
    holes, rows = dict[str, str](), list[tuple[str, re.Pattern[str]]]()
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        head, mark, text = line.partition(": ")
        if not mark or line.startswith("#"):
            continue
        for name, pattern in holes.items():
            text = text.replace(f"{{{name}}}", pattern)
        if head.startswith("hole "):
            holes[head.removeprefix("hole ")] = text
        else:
            rows.append(
                (head, re.compile(rf"(?<!\S)(?:{text})(?!\S)" if head != "courtesy" else text))
            )
    return rows


ASKED = re.compile(
    r"(?:please |hi |hey |ok |so |, |and )*(?:can|could|would|will|may|might|is it|is there|"
    r"do you)\b"
)
"""Start of a question that asks for something to be done."""
ROWS = _rows()
"""Patterns of frames by kind, in the order in which they are tried."""


@dataclass
class Frames:
    """A sentence taken apart; noun phrases are stand-ins."""

    asked: str
    """Text of what is asked, without the rest."""
    kept: list[str] = field(default_factory=list)
    """Things that stay: stand-ins, "it", "background", "rest"."""
    left_out: set[str] = field(default_factory=set)
    """Those of them that are only left out of what is asked of more: "all but the bear"."""
    said: list[str] = field(default_factory=list)
    """Words that say so."""
    weaker: bool = False
    """Whether a change goes less far than usual."""
    dropped: str = ""
    """Words that were asked and then taken back."""


def framed(text: str) -> Frames:
    """Take a text with stand-ins apart."""
    frames = Frames(text)
    for kind, pattern in ROWS:
        if kind == "retract":
            _retract(frames, pattern)
        elif kind == "courtesy":
            bare = pattern.sub(" ", frames.asked)
            if ASKED.match(frames.asked) and not ASKED.match(bare.strip()):
                bare = bare.replace("?", ".")
            frames.asked = _tidy(bare)
        else:
            _cut(frames, kind, pattern)
    frames.asked = _tidy(frames.asked)
    return frames


def _cut(frames: Frames, kind: str, pattern: re.Pattern[str]) -> None:
    """Cut what a pattern finds out of what is asked, and note what it says."""
    while match := pattern.search(frames.asked):
        if kind == "limit" and not frames.asked[: match.start()].strip(" ,.;!?"):
            return
        if kind in ("keep", "rest", "except"):
            if kind == "keep" and _isolates(match):
                return
            named = ["rest"] if kind == "rest" else _named(match["x"])
            frames.kept += named
            frames.left_out |= set(named) if kind == "except" else set()
            frames.said.append(match[0].strip(" ,"))
        elif kind == "deny":
            frames.dropped = match[0]
        elif kind == "limit":
            frames.weaker = True
        frames.asked = (
            f"{frames.asked[: match.start()]} , {frames.asked[match.end() :]}"
            if kind != "except"
            else f"{frames.asked[: match.start()]} {frames.asked[match.end() :]}"
        )


def _isolates(match: re.Match[str]) -> bool:
    """Whether all else is to go: "keep only the bear"."""
    return bool(re.match(r"(?:please |just )*keep only\b|(?:please )*only keep\b", match[0]))


def _named(text: str) -> list[str]:
    """Things that stay, as words name them: stand-ins, "it", "background" or "rest"."""
    found = NOUN.findall(text)
    plain = NOUN.sub("", text)
    if re.search(r"\b(?:it|him|her|them|itself)\b", re.sub(r"of (?:it|them)|around it", "", plain)):
        found.append("it")
    if re.search(
        r"background|backdrop|surround|environment|\bbg\b|scenery|garden|park|courtyard|room|yard|landscape|setting|around",
        plain,
    ):
        found.append("background")
    if (
        re.search(r"\b(?:rest|else|others?|everything|scene|picture)\b", plain)
        and "around" not in plain
    ):
        found.append("rest")
    return found


def _retract(frames: Frames, pattern: re.Pattern[str]) -> None:
    """Leave out what is taken back: the clause before "no wait"."""
    matches = [
        match
        for match in pattern.finditer(frames.asked)
        if frames.asked[: match.start()].strip(" ,.!;:")
        and frames.asked[match.end() :].strip(" ,.!?;:") not in ("", "it", "that", "this")
    ]
    if not matches:
        return
    match = matches[-1]
    if re.match(
        r"[ ,]*(?:just )?(?:leave|keep) (?:it|them|that|everything)\b", frames.asked[match.end() :]
    ):
        frames.asked = frames.asked[match.end() :]
        return
    before = frames.asked[: match.start()].strip(" ,.!;:?")
    earlier, _, last = before.rpartition(" and ")
    frames.dropped = last
    frames.asked = (
        f"{earlier} , {frames.asked[match.end() :]}" if earlier else frames.asked[match.end() :]
    )


def _tidy(text: str) -> str:
    """A text without marks and conjunctions that join nothing."""
    text = re.sub(r"\s+", " ", text).strip()
    text = re.sub(r"(?:(?:,|and|but|;|while|though|so|then|:) )+(?=[,.;!?:] |[,.;!?:]$)", "", text)
    text = re.sub(r"(?<=[.;!?,]) (?:[,.;] )*", " ", text)
    text = re.sub(r"^(?:(?:[,.;!?:]|and|but|so|then|while|though)(?: |$))+", "", text)
    return re.sub(r"(?: (?:[,;:]|and|but|while|so|then|though))+$", "", text).strip()
