"""Signed changes of tone that a clause asks for."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gsedit.words import amounts, lexicon
from gsedit.words.instruction import Change
from gsedit.words.scan import STATEMENTS, WISHES, Word

DEFAULT = {
    "brightness": 0.2,
    "contrast": 0.25,
    "saturation": 0.3,
    "warmth": 0.25,
    "hue": 1 / 12,
}
"""Share of a tone that is asked for without a number; plain to see, and no color is clipped."""
NO_SIGN = 0
PARTICLES = frozenset(("down", "ease"))
"""Words that go with a verb: to cool it down is no less cool."""
SLIGHT, STRONG = 0.5, 1.75


@dataclass(frozen=True)
class Manner:
    """Direction and size that a clause gives to its tones."""

    text: str
    up: bool
    down: bool
    complaint: bool
    """Whether it says what is too much."""
    lacking: bool
    """Whether it says what is not enough."""
    scale: float

    @property
    def direction(self) -> int:
        """Sign that the clause's verbs and complaints give to a quality that it names."""
        if self.lacking:
            return 1
        return -1 if self.complaint or self.down else 1


def manner(text: str, found: list[Word], followed: bool) -> Manner:
    """Manner of a clause; `followed` says whether a clause that asks to mend it comes after."""
    kinds = {word.kind for word in found}
    plain = set(re.findall(r"[a-z]+", text))
    states = bool(plain & STATEMENTS) and not plain & (WISHES - {"like", "can", "please"})
    lacking = "enough" in plain or bool(
        re.search(r"\btoo (?:little|few)\b|\black(?:s|ing)?\b", text)
    )
    complaint = bool(plain & {"overly", "excessively"}) or bool(
        re.search(r"\bthat (?:dark|bright|warm|cold|vivid)", text)
    )
    wished = bool(plain & {"make", "turn", "give"}) and "not" not in plain and "stop" not in plain
    complaint |= bool(re.search(r"\bnot (?:nearly |quite )?(?:as|that)\b", text))
    complaint |= "so" in plain and not wished
    complaint |= bool(re.search(r"\btoo\b(?= *[^ ])", text))
    complaint |= states or followed or bool(plain & {"underexposed", "overexposed", "fix"})
    scale = SLIGHT if "slight" in kinds else STRONG if "strong" in kinds and not complaint else 1.0
    return Manner(text, "up" in kinds, "down" in kinds, complaint and not lacking, lacking, scale)


def tones(how: Manner, found: list[Word], before: int) -> list[Change]:
    """Changes of tone of a clause, of target "scene"; `before` is the direction that an earlier
    clause gave, 0 for none."""
    signs = dict[str, int]()
    nouns = [word.value for word in found if word.kind == "noun"]
    styles = [_change(word.value, None, None) for word in found if word.kind == "style"]
    if styles:
        return styles
    for word in sorted(found, key=lambda each: each.kind == "word"):
        if word.kind in ("word", "turn"):
            name, sign = word.value.split()
            flipped = any(each.kind == "down" and each.text not in PARTICLES for each in found)
            turned = -1 if flipped or (how.complaint and word.kind == "word") else 1
            turned = 1 if how.lacking else turned
            times = amounts.factor(how.text)
            if word.kind == "word" and times is not None and times < 1:
                turned = -turned
            if nouns and how.up and word.kind == "word" and "more" not in how.text:
                continue
            signs.setdefault(name, (1 if sign == "+" else -1) * turned)
    if signs and not (how.up or how.down) and {"saturation"} >= set(nouns):
        nouns = []
    intense = [lexicon.INTENSE[word.value] for word in found if word.kind == "intense"]
    for name in nouns:
        if name in signs or (name == "saturation" and len(set(nouns)) > 1 and _bare_color(found)):
            continue
        sign = _noun_sign(how, intense, before)
        if sign and name != "hue":
            signs[name] = sign
    return [_change(name, _amount(how, name, sign), None) for name, sign in signs.items()]


def _bare_color(found: list[Word]) -> bool:
    return any(word.text in ("color", "colors") for word in found)


def _noun_sign(how: Manner, intense: list[int], before: int) -> int:
    if how.up and how.down:
        return NO_SIGN
    if intense:
        return intense[0] * (how.direction if how.complaint or how.down or how.lacking else 1)
    if how.lacking or how.up:
        return 1
    if how.down or how.complaint:
        return -1
    if re.search(r"[+-]\d", how.text):
        return -1 if re.search(r"-\d", how.text) else 1
    if (times := amounts.factor(how.text)) is not None:
        return 1 if times > 1 else -1
    return before


def hues(how: Manner, found: list[Word]) -> list[Change]:
    """Changes toward or away from a color: "redder", "too green", "a blue tint"."""
    colors = [(word.text, word.color) for word in found if word.kind == "color"]
    colors += [(lexicon.HUES[word.text], None) for word in found if word.kind == "hue"]
    if not colors:
        share = amounts.degrees(how.text)
        return [_change("hue", share * how.direction, None)] if share else []
    name, color = colors[0]
    sign = -1 if how.direction < 0 or re.search(r"\baway\b|\bremove\b|\brid\b", how.text) else 1
    size = amounts.share(how.text)
    if name in lexicon.COLOR_WARMTH and sign < 0:
        tone = sign * lexicon.COLOR_WARMTH[name]
        return [_change("warmth", tone * (size or DEFAULT["warmth"] * how.scale), None)]
    turn = amounts.degrees(how.text) or DEFAULT["hue"] * how.scale
    return [_change("hue", sign * turn, lexicon.PURE.get(name, color))]


def _amount(how: Manner, name: str, sign: int) -> float:
    times = amounts.factor(how.text)
    if times is not None and times > 0:
        many = times if (times > 1) == (sign > 0) else 1 / times
        return round(many - 1, 4)
    if times == 0:
        return -1.0
    size = amounts.share(how.text)
    if size is not None and size < 0:
        return size
    return sign * (abs(size) if size is not None else round(DEFAULT[name] * how.scale, 4))


def _change(name: str, amount: float | None, color: str | None) -> Change:
    return Change("scene", "tone", name, color, amount, "tone")
