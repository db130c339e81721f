"""Reader of a sentence: parsed first; what its words mean together is asked of the encoder last."""

from __future__ import annotations

import re
from dataclasses import replace

from gsedit.words import amounts, colors, lexicon, materials
from gsedit.words.instruction import Change, Instruction, Target
from gsedit.words.placing import join, merged, placed
from gsedit.words.reading import Reading, Refused
from gsedit.words.refusals import ACTS, GEOMETRY, NEGATION, PARTS, REASONS, first_refusal
from gsedit.words.scan import Word, scanned
from gsedit.words.small_looks import change_of_look, look_of, tone_change
from gsedit.words.targets import (
    BACKGROUND,
    KEEP_BACKGROUND,
    KEEP_SUBJECT,
    PLACE,
    SCENE,
    SUBJECT,
    marked,
)
from gsedit.words.tokens import clauses, normalised, words
from gsedit.words.tones import hues, manner, tones

FLOOR = 0.5
"""Least probability of a look that the encoder alone names; chosen on sentences of development."""
MOST = 9.0
"""Largest share of a tone that can be added."""
CLOSE = 25.0
"""Largest CIE 1976 difference of a material's asked color from that of the look of `small`."""
_MADE = re.compile(
    r"\b(made|out of|carve|carved|cast|material|turn <\w+> (?:in)?to|statue of|"
    r"solid|chisel|forged?|sculpted|stone|rock)\b"
)
_PAINT = re.compile(r"\b(paint|painted|color|colored|dye|dyed|spray|sprayed|tint|lacquer|hue)\b")
_MEND = re.compile(
    r"^(?:can you |please |could you |now )*(?:fix|reduce|lift|correct|soften|mend|"
    r"adjust|turndown|brighten|darken|tone)\b"
)


_THINGS = frozenset(
    [
        "sea",
        "sky",
        "dust",
        "dirt",
        "leaf",
        "grass",
        "desert",
        "camel",
        "water",
        "fire",
        "blood",
        "ocean",
        "ice",
        "tea",
        "earth",
    ]
)
"""Colors whose name is a thing first."""


def read_instruction(sentence: str) -> Instruction:
    """Changes that a sentence asks for, or why it is refused. Never a change that it forbids.

    The encoder is loaded only where no word of the sentence names a change. Raises InputError
    where its files are missing or damaged.
    """
    text = normalised(sentence)
    try:
        if kind := first_refusal(sentence, text):
            raise Refused(kind)
        changes = _parsed(_prepared(text)) or _meant(sentence, text)
        _check(changes)
    except Refused as refused:
        return Instruction(sentence, False, REASONS[str(refused)], ())
    return Instruction(sentence, True, "; ".join(map(str, changes)), tuple(changes))


def _prepared(text: str) -> str:
    """Text with numbers as digits, colors by number as "#rrggbb", parts marked and every "not"
    at the head of its own clause."""
    text = _with_colors(text)
    text = re.sub(r"\bfrom (?:the )?(?:\w+ ){1,2}to\b", "to", text)
    text = re.sub(
        r"\b(?:turn|change|convert|transform|replace) (?:the |this |that )?(\w+(?: \w+)"
        r"?) (?:in)?(to|with|by)\b",
        _exchanged,
        text,
    )
    text = re.sub(
        r"\b(copper|bronze|brass) with (?:a |some )?(?:green |greenish |light )"
        r"*(?:patina|verdigris)",
        r"patinated \1",
        text,
    )
    text = re.sub(r"\b(?:the )?color of\b", "color", marked(amounts.digits(text)))
    text = re.sub(
        r"\b(?:anything|any color|any other color|all|everything|whatever) (?:you like |"
        r"you want )?(?:but|except|other than|besides|apart from)(?: for)?\b|\binstead "
        r"of\b|\brather than\b|\bwithout\b|\b(?:but )?no\b(?! more than)",
        ", not ",
        text,
    )
    return re.sub(r"(?<=\S)\s+not\b(?![^,;.]*\b(?:enough|so|too|as|that|quite)\b)", ", not", text)


def _with_colors(text: str) -> str:
    """Text with colors by number as "#rrggbb", and those between two as one."""
    text = re.sub(
        r"rgb\s*\([^)]*\)|rgb \d+[, ]+\d+[, ]+\d+",
        lambda m: colors.hexadecimal(m[0]) or "unknowncolor",
        text,
    )
    text = re.sub(
        r"\bhex(?: code)?:? #?([0-9a-f]{6})\b|(?<![\w#])#?(?=[0-9a-f]*\d)([0-9a-f]{6})\b",
        lambda m: f"#{m[1] or m[2]}",
        text,
    )
    text = re.sub(
        r"\b(?:half ?way |somewhere |midway |in )?between ([a-z ]+?) and ((?:light |dark )?[a-z]+)",
        _midway,
        text,
    )
    return (
        re.sub(r"\bas (?=[a-z ]+ as\b)([a-z]+) as (?!is\b)[^,;.]*", r"\1", text)
        if re.search(r"\bas (?:" + "|".join(colors.PLAIN) + r") as\b", text)
        else text
    )


def _exchanged(match: re.Match[str]) -> str:
    """Text without a light or a look that gives way to another."""
    scenic = any(word.kind in ("light", "look") for word in scanned(words(match[1])))
    return f"make {match[2]}" if scenic else match[0]


def _midway(match: re.Match[str]) -> str:
    first, second = colors.named(match[1].strip()), colors.named(match[2].strip())
    return colors.between(first, second) if first and second else match[0]


def _parsed(text: str) -> list[Change]:
    """Changes that the words of a text name; empty where none does. Raises Refused."""
    parts = clauses(text)
    kept = [mark for mark in (KEEP_SUBJECT, KEEP_BACKGROUND) if mark in text]
    reading = Reading([], kept=kept[0] if len(set(kept)) == 1 else None)
    for index, part in enumerate(parts):
        followed = index + 1 < len(parts) and bool(
            _MEND.match(parts[index + 1]) and not re.search("<[sb]>", parts[index + 1])
        )
        _read_clause(part, followed, reading)
    if not reading.changes and (reading.negated or (kept and not reading.changes)):
        raise Refused("negation")
    return placed(merged(reading.changes), reading)


def _read_clause(text: str, followed: bool, reading: Reading) -> None:
    found = scanned(words(text))
    named = [word.value for word in found if word.value in (SUBJECT, BACKGROUND, SCENE, PLACE)]
    how = manner(text, found, followed)
    negative = bool(NEGATION.search(text))
    softened = negative and bool(re.search(r"\b(?:too|so|that|enough|overly|as)\b", text))
    plain = re.sub(r"<\w+>", " ", text)
    _refuse_parts(plain, text, found)
    changes = _clause_changes(how, found, text, reading)
    if re.search(r"\b(?:remove|rid of|take away|reduce|lose)\b.*\b(?:cast|tint|tinge)\b", text):
        negative, changes = False, hues(replace(how, complaint=True), found)
    elif softened and reading.changes and not any(c.kind == "tone" for c in reading.changes):
        return
    if negative and not softened:
        reading.negated = True
        if re.search(r"\b(?:remove|delete|erase|rid of)\b", text) and not changes:
            raise Refused("geometry")
        return
    if how.down and changes and not any(change.kind == "tone" for change in changes):
        raise Refused("negation")
    if how.up or how.down:
        reading.direction = -1 if how.down else 1
    join(changes, found, named, text, reading)


def _refuse_parts(plain: str, text: str, found: list[Word]) -> None:
    """Raise Refused for a clause about shape, or about a part that nothing finds."""
    told = re.sub(r"\b(?:as if|as though|like)\b.*", "", plain)
    if (
        re.search(r"\b(?:sky|wall|trees?|rocks?|ground|floor|grass|lawn)\b", told)
        and re.search(r"\b(?:paint|make|turn|darken|brighten|color)\b", told)
        and not any(w.kind in ("light", "look") for w in found)
    ):
        raise Refused("part")
    lit = any(word.kind in ("light", "look", "noun", "word", "turn") for word in found)
    if GEOMETRY.search(told) and not re.search(r"\b(?:like|as if)\b", plain) and not lit:
        raise Refused("geometry")
    if PARTS.search(told) and not any(word.kind in ("light", "look") for word in found):
        raise Refused("part")
    unknown = [word for word in found if word.kind == "unknown"]
    if ACTS.search(told) and unknown and not lit and unknown[-1].at > 0:
        raise Refused("geometry")
    if re.search(r"<s>", text) and any(re.search(rf"<s> {word.text}$", text) for word in unknown):
        raise Refused("part")
    named = any(
        re.search(rf"\b(?:the|its|his|her|left|right) {word.text}\b", told) for word in unknown
    )
    if named and any(word.kind in ("color", "material", "turn") for word in found):
        raise Refused("part")


def _clause_changes(how, found: list[Word], text: str, reading: Reading) -> list[Change]:
    """Changes of one clause, of its parts yet unsaid."""
    kinds = {word.kind for word in found}
    lights = _scenes(found)
    if any(word.value == "warmth" and word.kind == "noun" for word in found) and "color" in kinds:
        tint = [
            word.text
            for word in found
            if word.kind == "color" and word.text in lexicon.COLOR_WARMTH
        ]
        sign = lexicon.COLOR_WARMTH[tint[0]] * how.direction if tint else 0
        return [tone_change("warmth", 0.25 * sign)] if sign else []
    if "hue" in kinds or (
        re.search(r"\b(?:hue|tint|tinge|cast)\b", text) and "material" not in kinds
    ):
        return hues(how, found) or tones(how, found, reading.direction)
    if (
        "light" in set(words(text))
        and (how.up or how.down or how.lacking or "too" in text)
        and not lights
    ):
        found = [*found, Word("light", "noun", "brightness", 0)]
        kinds.add("noun")
    if (
        re.search(r"\b(?:too(?= *[^ ])|less|more|so)\b", text)
        and "color" in kinds
        and not {"material", "light", "look"} & kinds
    ):
        return hues(how, found)
    solid = _solids(how, found, text)
    tone = tones(how, found, reading.direction)
    if lights or solid:
        sure = {"turn"} | ({"noun"} if (how.up or how.down) else set())
        base = [
            word
            for word in found
            if word.kind in sure | {"style"} and not (word.value == "saturation" and solid)
        ]
        tone = tones(how, base, reading.direction) if base else []
    return solid + lights + tone


def _scenes(found: list[Word]) -> list[Change]:
    """Lights and looks of a clause, each look of `small` once."""
    changes = list[Change]()
    for word in found:
        if word.kind in ("light", "look"):
            draft = Change("scene", word.kind, word.value, None, None, "pix2pix")
            fits = look_of(draft)
            if not any(
                look_of(each) == fits and (fits or each.name == draft.name) for each in changes
            ):
                changes.append(replace(draft, route="small") if fits else draft)
    return changes


def _solids(how, found: list[Word], text: str) -> list[Change]:
    """Materials and paints of a clause, of target "subject" unless a part stands nearer."""
    finish = next((word.value for word in found if word.kind == "finish"), None)
    if "flat" in words(text) and any(word.kind == "color" for word in found):
        finish = finish or "matte"
    painted = bool(_PAINT.search(text))
    made = bool(_MADE.search(text))
    changes = list[tuple[int, Change]]()
    for index, word in enumerate(found):
        as_color = word.color and (painted or word.text in materials.COLOR_FIRST) and not made
        if word.kind == "material" and not as_color:
            changes.append((word.at, _material(word, found[:index], text)))
        elif word.color and word.kind in ("color", "material"):
            after = found[index + 1].kind if index + 1 < len(found) else ""
            if after in ("material", "light", "look") and not painted:
                continue
            if word.text in _THINGS and not painted:
                continue
            name = word.text if not finish else f"{finish} {word.text}"
            changes.append((word.at, Change("subject", "paint", name, word.color, None, "paint")))
    return [replace(c, target=_nearest(at, found)) for at, c in changes]


def _material(word: Word, before: list[Word], text: str) -> Change:
    """A material with the words before it that belong to it."""
    own, color = [word.text], None
    for each in reversed(before):
        first = each.text.split()[0]
        if each.kind in ("color", "finish") or first in lexicon.MATERIAL_WORDS:
            own.insert(0, each.text)
            color = color or (each.color if each.kind == "color" else None)
        else:
            break
    base = materials.MATERIALS[word.value]
    if "patinated" in own and word.value != "verdigris":
        return Change(
            "subject", "material", f"{word.value} with green patina", "#5f9e8f", None, "small"
        )
    name = word.value if len(own) == 1 else " ".join([*own[:-1], word.value])
    fits = word.value in materials.SMALL_MATERIALS and (
        not color or colors.distance(color, base) < CLOSE
    )
    return Change("subject", "material", name, color or base, None, "small" if fits else "paint")


def _nearest(at: int, found: list[Word]) -> Target:
    """Part that is named nearest to a word of a clause; the subject where none is."""
    marks = [word for word in found if word.value in (SUBJECT, BACKGROUND, SCENE, PLACE)]
    if not marks:
        return "subject"
    value = min(marks, key=lambda mark: (abs(mark.at - at), -mark.at)).value
    return {SUBJECT: "subject", BACKGROUND: "background", SCENE: "scene", PLACE: "background"}[
        value
    ]  # pyright: ignore[reportReturnType]


def _check(changes: list[Change]) -> None:
    for change in changes:
        if change.amount is not None and not -1 <= change.amount <= MOST:
            raise Refused("amount")


def _meant(sentence: str, text: str) -> list[Change]:
    """Changes that the encoder finds in a sentence whose words name none. Raises Refused."""
    from gsedit.words.reader import understand

    plain = words(text)
    kinds = {word.kind for word in scanned(plain)}
    if "finish" in kinds and "unknown" not in kinds:
        raise Refused("finish")
    if not plain:
        raise Refused("empty")
    if NEGATION.search(text) or "down" in kinds:
        raise Refused("negation")
    understood = understand(sentence)
    if kinds & {"noun", "word", "turn", "up"} and understood.known:
        toned = all(change_of_look(each.look).kind == "tone" for each in understood.looks)
        if toned:  # a tone is named and its direction is not understood
            raise Refused("nonsense")
    if not understood.known or understood.looks[0].score < FLOOR or len(plain) < 3:
        raise Refused("nonsense")
    return [change_of_look(each.look) for each in understood.looks if each.score >= FLOOR]
