"""Signed changes of tone that a clause asks for."""

from __future__ import annotations

from gsedit.words.amounts import Amount, amount_of
from gsedit.words.clauses import Clause
from gsedit.words.instruction import Change
from gsedit.words.lexicon import things
from gsedit.words.refusals import Refused
from gsedit.words.scan import Word

DEFAULT = {"brightness": 0.2, "contrast": 0.25, "saturation": 0.3, "warmth": 0.25, "hue": 1 / 12,
           "shadows": 0.3, "highlights": 0.3, "sharpness": 0.3}  # fmt: skip
"""Share of a tone that is asked for without a number; plain to see, and no color is clipped."""
QUALITIES = ("state", "intense")
RATHER = ("rather", "quite", "pretty", "fairly", "somewhat", "kinda")
"""Words that make a remark of a quality: "rather dull"."""
SLIGHT, STRONG = 0.5, 1.75
PARTICLES = frozenset(("down", "falls", "ease", "off", "out", "away"))
"""Words that go with a verb: to cool it down is no less cool, and night falls."""


def tones(clause: Clause, before: int) -> list[Change]:
    """Changes of tone of a clause, of target "scene"; `before` is the direction that an earlier
    clause gave, 0 for none. Empty where the direction is not said or said both ways."""
    words = clause.words
    styles = [word.value for word in words if word.kind == "style"]
    if styles:
        return [tone(styles[0], _part_of_full(clause))]
    if _emptied(words, clause):
        return [tone("grayscale", None)]
    signs = dict[str, int]()
    for word in sorted(words, key=lambda each: each.kind == "state"):
        if word.kind in ("state", "turn"):
            name, sign = word.value.split()
            signs.setdefault(name, (1 if sign == "+" else -1) * _turned(word, clause))
    nouns = _nouns(words, signs, clause)
    if not signs and not nouns and any(word.value == "stops" for word in words):
        nouns = ["brightness"]
    for name in nouns:
        if name not in signs and (sign := _noun_sign(clause, before)):
            signs[name] = sign
    given = amount_of(words)
    return [tone(name, _amount(given, clause, name, sign)) for name, sign in signs.items()]


def _part_of_full(clause: Clause) -> float | None:
    """Share in which a style is mixed in: "50 % sepia"; None for all of it. Raises Refused where
    there should be less of a style than there is, or more than all of it."""
    words, given = clause.words, amount_of(clause.words)
    share = given.share if given.factor is None else given.factor
    fewer = any(word.kind in ("factor", "fraction") for word in words)
    halved = given.factor is not None and fewer
    if halved or (asks_less(clause) and not clause.kinds() & {"noun", "state"}):
        raise Refused("negation")
    if share is not None and not 0 <= share <= 1:
        raise Refused("amount")
    return None if share == 1 else share


def tone(name: str, amount: float | None, color: str | None = None) -> Change:
    """Change of a tone of the whole scene."""
    return Change("scene", "tone", name, color, amount, "tone")


def complains(clause: Clause) -> bool:
    """Whether a clause says that there is too much of what it names: "it is dark"."""
    kinds, words = clause.kinds(), [word.text for word in clause.words]
    if "too" in clause.tags():
        return True
    said = [word.kind for word in clause.words]
    last = max((at for at, kind in enumerate(said) if kind not in ("fill", "be")), default=0)
    rather = last > 0 and (said[last - 1] == "slight" or words[last - 1] in RATHER)
    rather &= said[last : last + 1] == ["state"] and "please" not in words
    states = (
        "be" in said[:last]
        or stressed(clause, QUALITIES)
        or clause.tags() & {"flaw", "cure"}
        or rather
    )
    return bool(states) and not kinds & {"wish", "do", "turn"}


def stressed(clause: Clause, kinds: tuple[str, ...]) -> bool:
    """Whether a word of these kinds stands after "so" or "how"."""
    pairs = zip(clause.words, clause.words[1:])
    return any(word.text in ("so", "how") and after.kind in kinds for word, after in pairs)


def asks_less(clause: Clause) -> bool:
    """Whether a verb of a clause takes away."""
    verbs = [word for word in clause.words if word.kind == "down"]
    return clause.lost or any(word.text not in PARTICLES for word in verbs)


def hues(clause: Clause) -> list[Change]:
    """Changes toward or away from a color: "redder", "too green", "a blue tint"."""
    given = amount_of(clause.words)
    words = [word for word in reversed(clause.words) if word.kind in ("color", "hue")]
    less = clause.turned < 0 or complains(clause) or asks_less(clause)
    if clause.turned > 0 or "lack" in clause.tags():
        less = False
    if words and _leaves(clause.words, words[0]):
        less = clause.turned >= 0
    sign = -1 if less else 1
    if not words:
        return [tone("hue", sign * given.turn)] if given.turn else []
    word = words[0]
    name = things("hue").get(word.text, word.text)
    color = things("pure").get(name, word.color)
    name = name.removesuffix("s")  # "boost the whites"
    if neutral := things("neutral").get(name):
        tone_of, way = neutral.split()
        return [tone(tone_of, _amount(given, clause, tone_of, sign * int(way)))]
    if (warm := things("warm").get(name)) and less:
        size = abs(given.share or DEFAULT["warmth"] * _scale(clause))
        return [tone("warmth", -int(warm) * size)]
    return [tone("hue", sign * (given.turn or DEFAULT["hue"] * _scale(clause)), color)]


def _leaves(words: list[Word], name: Word) -> bool:
    """Whether "away from" stands before the name of a color or quality."""
    before = [word.text for word in words[: words.index(name)] if word.text != "the"]
    return before[-2:] == ["away", "from"]


def _emptied(words: list[Word], clause: Clause) -> bool:
    """Whether all color is taken away."""
    color = any(word.kind == "noun" and word.value == "saturation" for word in words)
    everything = {"all", "completely", "fully", "entirely", "totally", "zero", "drain"}
    told = {each for word in words for each in word.text.split()} & everything
    faded = any(word.value == "saturation -" for word in words)
    verb = color and (clause.lost or asks_less(clause))
    return (verb and (bool(told) or clause.lost)) or (faded and bool(told))


def _turned(word: Word, clause: Clause) -> int:
    """Sign that a clause gives to a quality."""
    if _leaves(clause.words, word):
        return -1
    if clause.turned:
        return clause.turned if word.kind == "state" else 1
    given = amount_of(clause.words)
    fewer = word.kind == "state" and given.factor is not None and given.factor < 1
    return -1 if asks_less(clause) or fewer or (word.kind == "state" and complains(clause)) else 1


def _nouns(words: list[Word], signs: dict[str, int], clause: Clause) -> list[str]:
    """Tones that nouns name; "color" is none beside a quality or a color."""
    moved = clause.kinds() & {"up", "down"} or clause.tags() & {"too", "lack"} or clause.lost
    found = list[str]()
    for word in words:
        loose = word.text in ("color", "colors", "coloring", "tint")
        if word.kind != "noun" or word.value == "hue" or (loose and signs):
            continue
        if word.value == "light":
            found += ["brightness"] * bool(moved and not signs)
        elif not (loose and any(each.kind == "color" for each in words)):
            found.append(word.value)
    return found


def _noun_sign(clause: Clause, before: int) -> int:
    """Sign of a tone that a noun names; 0 where it is not said, or both ways."""
    kinds, given = clause.kinds(), amount_of(clause.words)
    less, more = asks_less(clause) or "down" in kinds, "up" in kinds
    if "lack" in clause.tags() or "enough" in kinds or clause.turned > 0:
        return 1
    for word in clause.words:
        if word.kind == "intense":
            fewer = given.factor is not None and given.factor < 1
            flipped = complains(clause) or less or fewer or clause.turned < 0
            return (1 if word.value == "+" else -1) * (-1 if flipped else 1)
    if less and more:
        return 0
    if "slight" in kinds and not (less or more or "be" in kinds):
        return 1
    if less or more:
        return -1 if less else 1
    if complains(clause) and "cure" not in clause.tags():  # "fix the contrast" says no way
        return -1
    if given.factor is not None:
        under = any(word.text == "under" for word in clause.words)  # "two stops under"
        return 1 if given.factor > 1 and not under else -1
    marks = [word.text[0] for word in clause.words if word.kind == "number"]
    return next(({"+": 1, "-": -1}[mark] for mark in marks if mark in "+-"), before)


def _scale(clause: Clause) -> float:
    kinds = clause.kinds()
    return SLIGHT if "slight" in kinds else STRONG if "strong" in kinds else 1.0


def _amount(given: Amount, clause: Clause, name: str, sign: int) -> float:
    """Signed share of a tone. A factor on the other side of 1 is turned around: "twice as dark"."""
    if given.factor is not None:
        factor = given.factor
        agrees = (factor > 1) == (sign > 0) or factor == 0
        return round((factor if agrees else 1 / factor) - 1, 4)
    if given.share is not None:
        return given.share if given.share < 0 else sign * given.share
    return sign * round(DEFAULT[name] * _scale(clause), 4)
