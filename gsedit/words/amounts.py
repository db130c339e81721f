"""Amounts that words give: a factor of what is there, or a share that is added."""

from __future__ import annotations

from dataclasses import dataclass

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


def amount_of(words: list[Word]) -> Amount:
    """Amount of words; an empty one where none is said."""
    total, last = 0.0, None
    for at, word in enumerate(words):
        after = words[at + 1] if at + 1 < len(words) else None
        if word.value == "stops" and words[at - 1].text == "a":
            return Amount(factor=2.0)
        if word.kind == "factor":
            return Amount(factor=word.number)
        if word.kind == "fraction" and any(w.value == "stops" for w in words[at + 1 : at + 4]):
            return Amount(factor=2.0 ** (word.number * (last or 1.0)))
        if word.kind == "fraction" and not (after and after.kind == "number"):
            return _fraction(words, at, word.number * (last or 1.0))
        if word.kind == "number":
            beside = (*words[at - 1 : at], *words[at + 1 : at + 2])
            if word.number == 0 and any(each.kind == "noun" for each in beside):
                return Amount(factor=0.0)
            if after and after.kind == "number" and word.number >= 20 and after.number < 10:
                total = word.number
                continue
            last = total + word.number
            if found := _number(words, at, last):
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
    if after and after.kind == "fraction":
        return None
    added = word.text[0] in "+-" or (before is not None and before.text == "by")
    added |= any(each.kind in ("up", "down") for each in words)
    if "." in word.text or "/" in word.text:
        return Amount(share=number) if added and abs(number) < 1 else Amount(factor=number)
    plain = word.text[0] in "+-" or (before and before.text == "by")
    if before and before.text in OF_NOW and number > 1:
        return Amount(factor=number / 100)
    return Amount(share=number / 100) if plain else None


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
    remains = after == "as" or (after in ("of", "the") and "by" not in before) or "to" in before
    remains |= noun
    return Amount(factor=share) if remains else Amount(share=share)
