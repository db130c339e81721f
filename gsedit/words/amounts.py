"""Numbers of a clause, as a signed share or a share without a sign."""

from __future__ import annotations

import re

NUMBERS = {
    word: value
    for value, word in enumerate(
        [
            "zero",
            "one",
            "two",
            "three",
            "four",
            "five",
            "six",
            "seven",
            "eight",
            "nine",
            "ten",
            "eleven",
            "twelve",
            "thirteen",
            "fourteen",
            "fifteen",
        ]
    )
} | {
    "twenty": 20,
    "thirty": 30,
    "forty": 40,
    "fifty": 50,
    "sixty": 60,
    "seventy": 70,
    "eighty": 80,
    "ninety": 90,
    "hundred": 100,
    "twentyfive": 25,
}
FRACTIONS = {
    "half": 1 / 2,
    "third": 1 / 3,
    "thirds": 1 / 3,
    "quarter": 1 / 4,
    "quarters": 1 / 4,
    "fifth": 1 / 5,
    "fifths": 1 / 5,
    "sixth": 1 / 6,
    "eighth": 1 / 8,
    "tenth": 1 / 10,
    "tenths": 1 / 10,
}
_NUMBER = r"([+-]?\d+(?:\.\d+)?)"


def digits(text: str) -> str:
    """Text with its number words before % and "times" as digits."""
    names = "|".join(sorted(NUMBERS, key=len, reverse=True))
    tens = re.compile(rf"\b(twenty|thirty|forty|fifty|sixty|seventy|eighty|ninety)[ -]({names})\b")
    text = tens.sub(lambda m: str(NUMBERS[m[1]] + NUMBERS[m[2]]), text)
    text = re.sub(r"\b(?:a|one) hundred\b", "100", text)
    return re.sub(
        rf"\b({names})\b(?= (?:%|times|degrees?|stops?))", lambda m: str(NUMBERS[m[1]]), text
    )


def factor(text: str) -> float | None:
    """Factor of "half as", "to 70 %", "three times", "double"; None where none is said."""
    if re.search(r"\b(?:halve|half as|half the|to half|halved)\b", text):
        return 0.5
    if match := re.search(rf"(?:\bto {_NUMBER} ?%)|(?:{_NUMBER} ?% (?:of|as)\b)", text):
        return float(match[1] or match[2]) / 100
    if match := re.search(rf"{_NUMBER} ?(?:times|x|fold)\b", text):
        return float(match[1])
    words = {"double": 2, "doubled": 2, "twice": 2, "triple": 3, "thrice": 3, "quadruple": 4}
    return next((float(f) for word, f in words.items() if re.search(rf"\b{word}\b", text)), None)


def share(text: str) -> float | None:
    """Share of "20 %", "by a third", "one stop", "by 0.2"; with a sign where one is written."""
    if match := re.search(rf"{_NUMBER} ?%", text):
        return float(match[1]) / 100
    if match := re.search(r"\b(?:(a|an|one|two|three|four) )?(\w+)\b(?=\W|$)", text):
        for many, part in re.findall(r"\b(?:(a|an|one|two|three|four) )?([a-z]+)\b", text):
            if part in FRACTIONS:
                return NUMBERS.get(many, 1) * FRACTIONS[part]
    if match := re.search(rf"{_NUMBER} (?:f ?)?stops?\b", text):
        return 2 ** float(match[1]) - 1
    if match := re.search(r"\bby ([+-]?0?\.\d+)\b", text):
        return float(match[1])
    return None


def degrees(text: str) -> float | None:
    """Share of a full turn of "30 degrees"."""
    match = re.search(rf"{_NUMBER} ?deg(?:rees?)?\b", text)
    return float(match[1]) / 360 if match else None
