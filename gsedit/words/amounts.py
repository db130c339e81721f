"""Amounts that words give: a factor of what is there, or a share that is added; usual tones."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.words.instruction import Change
from gsedit.words.scan import Word

OF_NOW = ("to", "at")
"""Words before a number that is what remains, not what is added."""


@dataclass(frozen=True)
class Amount:
    """One amount; at most one of its fields is given."""

    factor: float | None = None
    """Share of what is there that remains: 0.8 for "to 80 %", 2 for "twice as"."""
    share: float | None = None
    """Added or taken, with the sign that is written: 0.2 for "20 %"."""
    turn: float | None = None
    """Share of a full circle."""


def number_of(words: list[Word]) -> float | None:
    """The number of words, 1.5 for "one and a half"; that of a factor first, None without any."""
    numbers = (at for at, word in enumerate(words) if word.kind in ("number", "fraction"))
    factors = (word.number for word in words if word.kind == "factor")
    first = next(numbers, None)
    return next(factors, None if first is None else _number_at(words, first)[0])


def _number_at(words: list[Word], at: int) -> tuple[float, int]:
    """(number that begins with a word, place of its last word)."""
    number = words[at].number
    rest = [i for i in range(at + 1, len(words)) if words[i].text not in ("and", "a", "an")]
    after = words[rest[0]] if rest else None
    if after is None or words[at].kind == "factor":
        return number, at
    if after.kind == "fraction":
        added = words[at + 1].text == "and"
        return number + after.number if added else number * after.number, rest[0]
    if after.kind == "number" and number >= 20 and after.number < 10:
        return number + after.number, rest[0]
    return (number * 100, rest[0]) if after.text == "hundred" else (number, at)


def amount_of(words: list[Word]) -> Amount:
    """Amount of words; an empty one where none is said."""
    at = -1
    while (at := at + 1) < len(words):
        word = words[at]
        if word.value == "stops" and words[at - 1].text == "a":
            return Amount(factor=2.0)
        if word.kind == "factor":
            return Amount(factor=word.number)
        if word.kind not in ("number", "fraction"):
            continue
        number, at = _number_at(words, at)
        if words[at].kind == "fraction":
            stops = any(each.value == "stops" for each in words[at + 1 : at + 4])
            return Amount(factor=2.0**number) if stops else _fraction(words, at, number)
        if found := _number(words, at, number):
            return found
    return Amount()


def _number(words: list[Word], at: int, number: float) -> Amount | None:
    """Amount of a number by the unit beside it; None where it has none and stands alone."""
    word, before = words[at], words[at - 1] if at else None
    after = words[at + 1] if at + 1 < len(words) else None
    unit = after.value if after and after.kind == "unit" else None
    match unit:
        case "%":
            return _percent(words, at, number / 100)
        case "stops":
            return Amount(factor=2.0**number)
        case "times":
            return Amount(factor=number)
        case "degrees":
            return Amount(turn=number / 360)
    signed = word.text[0] in "+-" or (before is not None and before.text == "by")
    added = signed or any(each.kind in ("up", "down") for each in words)
    if "." in word.text or "/" in word.text:
        return Amount(share=number) if added and abs(number) < 1 else Amount(factor=number)
    if before and before.text in OF_NOW and number > 1:
        return Amount(factor=number / 100)
    return Amount(share=number / 100) if signed else None


def _percent(words: list[Word], at: int, share: float) -> Amount:
    """A percentage as what is added, or as what remains: "to 80 %", "80 % of the brightness"."""
    before = words[at - 1].text if at else ""
    after = words[at + 2] if at + 2 < len(words) else words[at]
    remains = (before in OF_NOW and after.kind != "turn") or after.text in ("of", "as")
    return Amount(factor=share) if remains else Amount(share=share)


def _fraction(words: list[Word], at: int, share: float) -> Amount:
    before = [word.text for word in words[max(at - 4, 0) : at]]
    after = words[at + 1].text if at + 1 < len(words) else ""
    noun = at + 1 < len(words) and words[at + 1].kind == "noun"
    remains = noun or after == "as" or (after in ("of", "the") and "by" not in before)
    return Amount(factor=share) if remains or "to" in before else Amount(share=share)


DEFAULT = {"brightness": 0.2, "contrast": 0.25, "saturation": 0.3, "warmth": 0.25, "hue": 1 / 12,
           "shadows": 0.3, "highlights": 0.3, "sharpness": 0.3}  # fmt: skip
"""Share of a tone that is asked for without a number; plain to see, and no color is clipped."""
SLIGHT, STRONG = 0.5, 1.75
"""Shares of it for "a little" and for "much"."""


def tone(name: str, amount: float | None, color: str | None = None) -> Change:
    """Change of a tone of the whole scene."""
    return Change("scene", "tone", name, color, amount, "tone")
