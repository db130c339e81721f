"""Changes that are meant by what is marked in a sentence. Loads no torch."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from gsedit.words import colors
from gsedit.words.amounts import DEFAULT, SLIGHT, STRONG, amount_of, tone
from gsedit.words.instruction import MOST, Change
from gsedit.words.lexicon import pattern, things
from gsedit.words.marks import values
from gsedit.words.marks.actions import UNREAL, action, inserted
from gsedit.words.marks.marked import BACKGROUND, PRONOUN, WHOLE, Asked, Marked, loose, phrase
from gsedit.words.names import light_of, lights
from gsedit.words.phrases import IT, QUALITY, owned
from gsedit.words.refusals import Refused
from gsedit.words.scan import scanned

SCALES = {"": 1.0, "little": SLIGHT, "much": STRONG}
"""Shares of a tone's usual amount."""
MIXED = re.compile(r"\b(?:mix|mixed|mixture|blend|blended|cross)\b", re.IGNORECASE)
"""Words that make one look of two."""
PAINTED = re.compile(r"\b(?:paint|painted|dye|dyed|colou?r|coat of)\b", re.IGNORECASE)
"""Words that make a paint of what is a material too: "paint it gold"."""
ONLY = r"\bonly (?:on|at|in|for|to) {0}\b|\b{0} only\b"
"""Words for what alone changes."""
TONED = pattern("toned")
"""Words of a tone's quality, before whose it is."""
SUBJECT = re.compile(r"^(?:the )?(?:subject|main thing|main object)$")
"""Phrases of the subject."""
SOLID = ("material", "paint", "growth", "object")
STAYS_SO = pattern("stayed").pattern
"""Words before a name that say that something has it and stays."""
DENIED = pattern("denied")
"""A sentence, or a clause, that begins or ends with a denial."""
LIT = re.compile(r"\b(?:only|just|alone|solely)\b", re.IGNORECASE)
"""Words that make of a light on a thing a light on that thing alone."""


def changes_of(said: Marked, files: Sequence[str] = ()) -> list[Change]:
    """Changes of what is marked in a sentence. Raises Refused for what nothing does."""
    found, last, left, kept = list[Change](), "", list(files), list(said.kept)
    for before, asked in zip((None, *said.asked), said.asked):
        if stays(asked, said):
            kept.append(asked.of or IT)
            continue
        both = before and before.deed == asked.deed == "tone" and asked.of == before.of
        both = both and not any(map(WHOLE.match, said.text.split()))
        if before and both and asked.part == "scene":
            asked = replace(asked, part=before.part)  # "make the bear brighter and warmer"
        put = asked.of_file and asked.deed in ("move", "copy")
        if left and (put or asked.deed == "insert"):
            change = inserted(left.pop(0), asked)
        else:
            change = _change(asked, said.text)
            change = _placed(change, asked, said.text, last)
        found.append(change)
        if change.route == "style":
            words = said.text if MIXED.search(said.text) else asked.name
            others = (each for each in values.mixed(words) if each != change.name)
            found += [replace(change, name=each) for each in others]
        if change.target == "subject" and change.phrase not in ("", IT):
            last = change.phrase
        if change.name in ("copy", "insert"):
            last = "the copy" if change.name == "copy" else change.phrase
    found = _once(found)
    _refuse_two(found)
    if any(change.name in (values.GLOW, "lava") for change in found):  # it glows in that light
        found.sort(key=lambda change: change.kind != "light")
    if not found:
        raise Refused("kept", *kept)
    return _but([_checked(each) for each in found], kept)


def stays(asked: Asked, said: Marked) -> bool:
    """Whether what is marked as a change is what stays, as "the crane left yellow", or a tone of a
    clause that says what must not be, with another change elsewhere."""
    text, name, thing = said.text.lower(), asked.name.lower(), re.sub(r"^the ", "", asked.of)
    if asked.deed in SOLID and name:
        stayed = re.search(STAYS_SO.replace("NAME", re.escape(name)), text)
        return stayed is not None and text.count(name) == 1
    if asked.deed != "tone" or asked.part != "span" or not thing:
        return False
    clauses = re.split(r"[,;.!?]|\b(?:but|just|only|instead)\b", text)
    rest = " , ".join(each for each in clauses if not DENIED.match(each))
    tones = {word.value.split()[0] for word in scanned(rest) if word.kind in ("state", "turn")}
    others = any(other.of and other.of.removeprefix("the ") in rest for other in said.asked)
    return others and thing in text and thing not in rest and asked.tone not in tones


def _once(changes: Sequence[Change]) -> list[Change]:
    """Changes without those that are said twice, actions apart; the one that tells more stays."""
    found = dict[object, Change]()
    for at, change in enumerate(changes):
        way = change.kind == "tone" and ((change.amount or 0) > 0, change.color)
        named = (change.kind, change.name, change.target, change.phrase, way)
        usual = DEFAULT.get(change.name, abs(change.amount or 0))
        key = at if change.kind == "object" else named
        if key not in found or change.color or abs(change.amount or 0) != usual:
            found[key] = change
    return list(found.values())


def _refuse_two(changes: Sequence[Change]) -> None:
    """Raise Refused for two coats or contrary tones of one part, and for two times of day."""
    coats = [(c.target, c.phrase, c.kind == "tone" and (c.name, c.color)) for c in changes
             if c.kind in ("paint", "material", "tone") and c.name != values.GLOW]  # fmt: skip
    times = [c for c in changes if c.kind == "light" and light_of(c.name) in lights("time")]
    if len(set(coats)) < len(coats) or len(times) > 1:
        raise Refused("two")


def _change(asked: Asked, text: str) -> Change:
    """A change, of its usual part. Raises Refused."""
    if asked.deed != "tone" and asked.name.lower() in things("hue"):  # "the sky bluer"
        asked = replace(asked, deed="tone", tone="hue", sign=1)
    match asked.deed:
        case "tone":
            return _toned(asked, text)
        case "paint":
            name = led(asked, text)
            found = values.finish(name) or values.paint(name) or values.material(name)
        case "material":
            name = led(asked, text)
            found = PAINTED.search(text) and values.paint(name)
            found = found or values.finish(name) or values.material(name) or values.paint(name)
        case "cover":
            found = values.cover(asked.name, asked.degree)
            share = amount_of(scanned(asked.amount)).share
            if share and found and found.kind == "growth":
                found = replace(found, amount=-share if "thin" in asked.after else share)
        case "light" | "weather" | "look":
            side = asked.side if asked.deed == "light" else ""
            lit = f"{asked.name} light" if asked.deed == "light" else ""
            name = lit if lit and lit in text else asked.name
            found = values.scenic(asked.deed, name, side, asked.degree)
        case "remove" | "scale" | "turn" | "move" | "copy":
            return action(asked, text, IT)
        case "insert":
            raise Refused("insert")
        case _:
            raise Refused("geometry", asked.name)
    dim = found is not None and found.kind == "light" and found.name.startswith("lamp")
    if found is None or (dim and asked.value not in ("", "lamp")):
        found = found if asked.value_sure < values.SEAL else None
    if found is None and UNREAL.match(asked.name):
        raise Refused("unreal")
    found = found or values.whole(asked.name)
    if found is None and (asked.deed != "look" or not asked.name):
        found = values.meant(asked.value, asked.value_sure, asked.deed, asked.side, asked.degree)
    if found is None:
        raise Refused("style" if asked.deed == "look" else "unknown", asked.name, *asked.near)
    if found.kind in ("light", "look"):
        return values.as_strong(found, amount_of(scanned(_amount(asked))), asked)
    return found


def led(asked: Asked, text: str) -> str:
    """A name with the words for a finish or a shade that stand right beside it in the text."""
    name, thing = asked.name, "".join(asked.of.split()[-1:])
    if f"{name} finish" in text and values.finish(f"{name} finish"):
        return f"{name} finish"
    before = text[: text.find(name)].split() if name and name in text else []
    if thing in map(str.lower, before[-1:]) and not scanned(thing)[0].has("shade"):
        return name  # "the windows blue"
    longer = (" ".join([*before[-count:], name]) for count in (3, 2, 1) if before[count - 1 :])
    if found := next((each for each in longer if colors.named(each.lower())), ""):
        return found
    while before and (word := scanned(before[-1])) and len(word) == 1:
        if word[0].kind != "finish" and not word[0].has("shade"):
            break
        name = f"{before.pop()} {name}"
    return name


SHADOW = r"^(?!.*not ).*(less) shadow|shadows?(?: (?!and )\w+)* (?:(weaker|softer)|longer|shorter)"
"""Shadows that become lighter, in a group; where none is, longer: their length is the sun's."""


def _toned(asked: Asked, text: str) -> Change:
    """A signed change of a tone. Raises Refused."""
    given, name, sign = amount_of(scanned(_amount(asked))), asked.tone, asked.sign or 1
    if name == "shadows" and (told := re.search(SHADOW, text.lower())):
        if not any(told.groups()):
            raise Refused("unreal")
        sign = 1
    if name in ("grayscale", "sepia", "negative"):
        share = given.share if given.factor is None else given.factor
        return tone(name, abs(share) if share and abs(share) < 1 else None)
    if name == "hue":
        color = values.color_of(asked.name) or values.color_of(text if not asked.name else "")
        if color is None and not given.turn:
            raise Refused("unknown", asked.name)
        return tone("hue", sign * abs(given.turn or DEFAULT["hue"] * SCALES[asked.degree]), color)
    if name not in DEFAULT:
        raise Refused("nonsense")
    if given.factor is not None and given.factor != 1:
        agrees = (given.factor > 1) == (sign > 0) or given.factor == 0
        factor = given.factor if agrees else given.factor + 1 if sign > 0 else 1 / given.factor
        return tone(name, round(factor - 1, 4))
    if given.share is not None:
        return tone(name, sign * abs(given.share))
    return tone(name, sign * round(DEFAULT[name] * SCALES[asked.degree], 4))


def _amount(asked: Asked) -> str:
    """Words of an amount with those beside it that tell what remains from what is added."""
    led = asked.amount.startswith(("to ", "at ", "by "))
    after = asked.after if asked.after in ("of", "as", "x", "times") else ""
    return f"{'' if led or not asked.amount else 'by '}{asked.amount} {after}".strip()


def _placed(change: Change, asked: Asked, text: str, last: str) -> Change:
    """A change with the part that it is of; `last` is the phrase that was named before."""
    part, of = asked.part, asked.of
    only = of.endswith(" in the background") or re.search(ONLY.format(re.escape(of)), text, re.I)
    if part == "background" and only:
        part = "span"
    of = TONED.sub("", of) if change.kind == "tone" else of
    of = re.sub(r" from (?:the )?\w+$", "", of) if change.kind == "light" else of
    if part == "span":
        part = "background" if BACKGROUND.match(of) else "scene" if WHOLE.match(of) else part
        part = "it" if PRONOUN.match(of) or not of else part
    if part == "span" and of.startswith("the behind "):
        part, of = "but", phrase(of.removeprefix("the behind "))
    solid, told = change.kind in SOLID, "the copy" if of in things("copied") else of
    if part == "span" and change.name == "brightness" and (lamp := values.lamp(of)):
        return replace(lamp, amount=change.amount)  # "make the moonlight brighter"
    if change.kind == "light" and part in ("span", "it"):
        alone = part == "span" and (LIT.search(text) or tells(of))
        return replace(change, target="subject", phrase=told) if alone else change
    bare = IT if change.kind == "object" else ""
    match part:
        case "span":
            found = replace(change, target="subject", phrase=told)
        case "but" if BACKGROUND.match(of):
            found = replace(change, target="subject", phrase="")
        case "but":
            found = replace(change, target="background", phrase="" if PRONOUN.match(of) else told)
        case "background":
            found = replace(change, target="background", phrase=bare)
        case "scene":
            found = replace(change, target="scene", phrase="")
        case _ if SUBJECT.match(of):
            found = replace(change, target="subject", phrase=bare)
        case _ if last and change.kind != "look":
            found = replace(change, target="subject", phrase=last)
        case _:
            found = replace(change, target="subject" if solid else "scene", phrase=bare)
    place = found.place
    if place and place.of == IT and found.name == "copy":
        found = replace(found, place=replace(place, of=found.phrase))
    return found


def tells(phrase: str) -> bool:
    """Whether a phrase has a color, a size or a place that tells a thing from others."""
    words = scanned(phrase)
    sized = {text for word in words for text in word.text.split()} & {*things("telling"), "one"}
    return bool(sized) or any(word.kind in ("color", "direction") for word in words)


def _checked(change: Change) -> Change:
    """A change whose amount is in range. Raises Refused."""
    most = MOST.get(change.kind)
    if most is not None and not -1 <= (change.amount or 0) <= most:
        raise Refused("amount")
    if change.target == "background" and change.phrase and not owned(change).phrase:
        raise Refused("kept", change.phrase)
    return change


def _but(changes: list[Change], kept: Sequence[str]) -> list[Change]:
    """Changes without what stays. Raises Refused where nothing is left, or all."""
    named = [each for each in kept if not loose(each)]
    rest = any(BACKGROUND.match(each) or WHOLE.match(each) for each in kept)
    pronoun = any(PRONOUN.match(each) for each in kept)
    if not kept and any(c.name == "remove" and c.target == "scene" for c in changes):
        raise Refused("everything")
    return [_without(each, named, rest, pronoun, kept) for each in changes]


def _without(
    change: Change, named: list[str], rest: bool, pronoun: bool, kept: Sequence[str]
) -> Change:
    """A change without what stays. Raises Refused."""
    if change.name in ("copy", "insert") or not kept:
        return change
    phrase = change.phrase
    if rest and change.target == "scene":
        change = replace(change, target="subject")
    if rest and change.target == "background" and not phrase:
        raise Refused("kept", kept[0])
    if pronoun and phrase in ("", IT):
        if change.target == "subject" and change.kind in SOLID and not named:
            raise Refused("kept", kept[0])
        change = replace(change, target="background", phrase="")
    if change.target == "background" and phrase:
        return replace(change, keep=tuple(each for each in named if each != phrase))
    if phrase in named:
        raise Refused("kept", phrase)
    thing = next((each for each in named if QUALITY.sub("", each)), None)
    if thing and change.target == "scene":
        keep = tuple(each for each in named if each != thing)
        return replace(change, target="background", phrase=thing, keep=keep)
    if pair := re.match(r"the (?:back|front|left|right|top|bottom|rear) (\w+)$", phrase):
        named = [re.sub(r"^(the \w+) ones$", rf"\1 {pair[1]}", each) for each in named]
    change = replace(change, keep=tuple(named))
    return owned(change) if change.target == "background" else change
