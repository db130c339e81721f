"""Grader of read sentences against files of sentences with their meanings, JSON lines.

Grades: right, rightly refused, partly, wrongly refused, wrong, OPPOSITE. A kept thing that changes
or a reversed sign is an opposite; a change that is neither made nor told to be unread is a silent
loss. `python tests/meanings.py FILE ... [-v]` prints rates by kind, and the failures.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from sentence_grades import read_all

from gsedit.words import colors
from gsedit.words.instruction import Change, Instruction
from gsedit.words.scan import scanned

GOOD = ("right", "rightly refused")
SCENIC = ("light", "weather", "look")
LAYERS = ("material", "cover", "paint")
OBJECTS = ("remove", "scale", "turn", "move", "copy", "insert")
WHOLE = re.compile(
    r"^(?:the )?(?:whole |entire )?(?:scene|picture|photo|image|everything|it all|shot|frame|"
    r"view|render|all)$"
)
REST = re.compile(
    r"\b(?:rest|else|others?|background|surroundings?|backdrop|bg|environment|everything|scene|around)\b"
)
IT = re.compile(
    r"^(?:it|him|her|them|this|that|these|those|the (?:subject|main thing|thing|object|model)"
    r"|subject)$"
)
ALIKE = [
    set(row.split())
    for row in (Path(__file__).parent / "data/sentences/alike.txt").read_text().splitlines()
]
"""Words that are near enough for the eyes of a person who asked for one of them."""
IDLE = frozenset(
    ("a", "an", "the", "of", "in", "with", "like", "made", "style", "look", "light", "painting",
     "effect", "and", "on", "from", "to", "very")
)  # fmt: skip


def words_of(text: str) -> set[str]:
    found = set(re.findall(r"[a-z0-9#]+", text.lower().replace("grey", "gray"))) - IDLE
    return found | {w[:-1] for w in found if len(w) > 3 and w.endswith("s")}


def alike(made: str, asked: str) -> bool:
    """Whether two names of a material, light or look are near."""
    one, other = words_of(made), words_of(asked)
    if one & other:
        return True
    if any(group & one and group & other for group in ALIKE):
        return True
    values = {w.value for w in scanned(asked) if w.kind in ("material", "look", "light", "style")}
    return any(
        value == made or value in made.split(" from ")[0].split(" with ") for value in values
    )


def color_of(name: str) -> str | None:
    return next((w.color for w in scanned(name) if w.color), None)


def head(phrase: str) -> str:
    """Head noun of a phrase, in the singular."""
    phrase = re.sub(r"[’']s\b", " 's", phrase.lower())
    phrase = re.sub(r"^(?:the|my|our|your|his|her|that|this|those|these|a) ", "", phrase)
    phrase = re.split(
        r" (?:on|in|at|behind|under|by|next|with|near|of|from|above|below|around|over|beside|"
        r"that|to|standing|between|facing|off|along|where|outside|inside|across|against|"
        r"holding|nearest|closest|left|right|lhs|rhs)\b",
        phrase,
    )[0]
    found = re.findall(r"[\w#-]+", phrase) or [""]
    last = found[-1]
    return last[:-1] if last.endswith("s") and len(last) > 3 else last


def same_thing(one: str, other: str) -> bool:
    """Whether two phrases have one head noun, slips of the pen aside."""
    first, second = head(one), head(other)
    if first == second or SequenceMatcher(None, first, second).ratio() >= 0.75:
        return True
    return head(one) in words_of(other) and head(other) in words_of(one)


PLACE = re.compile(
    r"\b(?:garden|park|courtyard|room|yard|landscape|kitchen|hall|studio|cafe|shop|street|"
    r"village|museum|cellar|library|workshop|cave|church|market|souk|temple|house|whole "
    r"thing|place|outside|sky)$"
)
"""Nouns of places, in which all of the scene is."""


def on_target(made: Change, of: str, do: str = "") -> bool:
    """Whether a change is of what was meant: light, and weather, fall on all that is there, or on
    all but what stays."""
    everywhere = (made.target == "scene" and not made.phrase) or (
        made.target == "background" and bool(made.phrase) and do in ("light", "weather")
    )
    if do in ("light", "weather") and everywhere and "but" not in of and "except" not in of:
        return True
    if PLACE.search(of.lower()) and everywhere:
        return True
    of = of.lower().strip()
    phrase = made.phrase if made.phrase != "it" else ""
    if WHOLE.match(of):
        return (made.target == "scene" and not phrase) or (
            made.target == "background" and bool(phrase)
        )
    if IT.match(of):
        return (not phrase and made.target in ("scene", "subject")) or bool(IT.match(phrase))
    if but := re.match(
        r"(?:everything|all|everywhere|the rest|scene|the scene|whole scene)(?: \w+)? (?:but|"
        r"except|except for|apart from|other than|besides)(?: for)? (.+)",
        of,
    ):
        things = re.split(r",| and ", but[1])
        told = [phrase, *made.keep]
        if made.target != "background":
            return False
        return all(
            any(same_thing(t, each) for each in told if each)
            or (not phrase and IT.match(t.strip()) is not None)
            for t in things
        )
    if REST.search(of) and not re.search(r"behind|above", of):
        return made.target == "background" or head(phrase) in ("background", "rest", "surrounding")
    if (
        made.target == "background"
        and not phrase
        and head(of) in words_of("sky ground floor grass lawn wall tree")
    ):
        return False
    return bool(phrase) and made.target == "subject" and same_thing(phrase, of)


def does(made: Change, asked: dict[str, Any]) -> bool:
    """Whether a change is of the kind, name, sign and amount that were meant."""
    do, name = asked["do"], str(asked.get("name", ""))
    if do == "tone":
        return tone_done(made, asked)
    if do == "paint":
        if made.kind == "tone" and made.name == "hue" and (made.amount or 0) > 0:
            return near_color(made.color, name, 130)
        if made.kind in ("material", "growth"):
            return alike(made.name, name) or near_color(colors.named(made.name), name, 25)
        return made.kind == "paint" and (near_color(made.color, name, 35) or made.name == name)
    if do in ("material", "cover"):
        if made.kind == "paint":
            return bool(words_of(made.name) & words_of(name))
        if made.kind == "look":
            return do == "cover" and alike(made.name, name)
        return made.kind in ("material", "growth") and alike(made.name, name)
    if do in SCENIC:
        if made.kind == "tone":
            return made.name in ("grayscale", "sepia", "negative") and alike(made.name, name)
        side = str(asked.get("side", ""))
        sided = (
            side in ("", "front")
            or side in str(made)
            or (side == "above" and "noon" in made.name)
            or (side == "behind" and "back" in made.name)
        )
        return made.kind in ("light", "look", "growth") and sided and alike(made.name, name)
    if made.kind == "object" and made.name == do:
        return object_done(made, asked)
    return False


def tone_done(made: Change, asked: dict[str, Any]) -> bool:
    name, sign, amount = asked["name"], asked.get("sign", 1), asked.get("amount")
    name = {"exposure": "brightness", "black and white": "grayscale"}.get(name, name)
    if made.kind in ("light", "look"):
        return made.kind == "light" and name == "brightness" and "dimm" in str(made)
    if made.kind != "tone":
        return False
    if name == "grayscale":
        return made.name == "grayscale" or (made.name == "saturation" and made.amount == -1)
    if name in ("sepia", "negative"):
        return made.name == name
    if name == "hue":
        return hue_done(made, asked)
    if name == "warmth" and made.name == "hue" and made.color:
        warm = colors.lab_of(made.color)[2] > 0
        return warm == ((made.amount or 0) * sign > 0)
    if made.name == "grayscale" and name == "saturation" and sign < 0:
        return amount in (None, 1, 1.0)
    if made.name != name or (made.amount or 0) * sign <= 0:
        return False
    return amount is None or abs(abs(made.amount or 0) - abs(amount)) <= max(
        0.07, 0.3 * abs(amount)
    )


def hue_done(made: Change, asked: dict[str, Any]) -> bool:
    color, sign = asked.get("color"), asked.get("sign", 1)
    wanted = color_of(str(color)) if color else None
    if made.name == "warmth" and wanted:
        return (colors.lab_of(wanted)[2] > 0) == ((made.amount or 0) * sign > 0)
    if made.name != "hue":
        return False
    if not wanted or not made.color:
        return True
    return (colors.lab_of(made.color)[1:] @ colors.lab_of(wanted)[1:]) * (
        made.amount or 1
    ) * sign > 0


def near_color(color: str | None, name: str, most: float) -> bool:
    wanted = color_of(name)
    if color is None or wanted is None:
        return False
    return colors.distance(color, wanted) <= most


def object_done(made: Change, asked: dict[str, Any]) -> bool:
    amount, sign, to = asked.get("amount"), asked.get("sign"), str(asked.get("to", ""))
    said = made.amount or 0.0
    match asked["do"]:
        case "scale":
            if sign and said * sign < 0:
                return False
            return amount is None or abs((1 + said) - amount) <= 0.15 * amount
        case "turn":
            if sign and abs(said) != 0.5 and said * sign < 0:
                return False
            return amount is None or abs(abs(said) * 360 - abs(amount)) < 3
        case "move" | "copy" | "insert":
            if asked["do"] == "copy" and (amount or 1) != (made.amount or 1):
                return False
            side = next(
                (s for s in ("left", "right", "up", "down") if re.search(rf"\b{s}\b", to)), None
            )
            if side and made.place and made.place.side in ("left", "right", "up", "down"):
                return made.place.side == side
            return True
    return True


def opposed(made: Change, asked: dict[str, Any]) -> bool:
    """Whether a change has the reversed sign of what was meant."""
    sign, said = asked.get("sign"), made.amount or 0
    if not sign or not said or said * sign > 0:
        return False
    name = {"exposure": "brightness"}.get(str(asked.get("name")), asked.get("name"))
    if asked["do"] == "tone":
        return made.kind == "tone" and made.name == name and name != "hue"
    return (
        asked["do"] in ("scale", "turn")
        and made.kind == "object"
        and made.name == asked["do"]
        and abs(said) != 0.5
    )


def kept(made: Change, keep: str) -> str:
    """ "" where a change leaves a kept thing alone for sure; "lost" where that is not told;
    "hit" where it changes."""
    phrase = made.phrase if made.phrase != "it" else ""
    if made.name in ("insert", "copy"):
        return ""
    out = [*made.keep, *([phrase] if made.target == "background" and phrase else [])]
    if any(same_thing(each, keep) for each in out):
        return ""
    if made.target == "background" and not phrase and IT.match(keep.lower()):
        return ""
    if IT.match(keep.lower()) and made.target == "subject" and phrase:
        return "lost"
    if REST.search(keep.lower()) and not re.search(
        r"behind the|of the (?!scene|picture|photo|image|room)", keep.lower()
    ):
        return "" if made.target == "subject" or (made.target == "background" and out) else "hit"
    if made.target in ("scene", "background"):
        return "hit"
    return "hit" if same_thing(phrase, keep) else "lost"


def grade(entry: dict[str, Any], read: Instruction) -> tuple[str, bool]:
    """(grade, whether something is lost in silence) of a sentence as it was read."""
    options = [entry["changes"], *entry.get("or", [])]
    if not read.known:
        refused = "rightly refused" if entry["refuse"] != "no" else "wrongly refused"
        return refused, False
    if entry["refuse"] == "must" and not any(options):
        return "wrong", False
    keeps = [kept(c, k) for c in read.changes for k in entry.get("keep", [])]
    best, lost = "wrong", True
    for asked in options:
        result, missing = compared(read.changes, asked)
        if RANK.index(result) < RANK.index(best):
            best, lost = result, missing
    if "hit" in keeps or (
        best == "wrong" and any(opposed(c, a) for c in read.changes for a in entry["changes"])
    ):
        return "OPPOSITE", True
    if "lost" in keeps and best == "right":
        return "partly", True
    return best, lost and not read.unread and best != "right"


RANK = ("right", "partly", "wrong")


def compared(made: Sequence[Change], asked: Sequence[dict[str, Any]]) -> tuple[str, bool]:
    left, hits, near, last = list(made), 0, 0, "it"
    for each in asked:
        done = [c for c in left if does(c, each)]
        of, do = each["of"], each["do"]
        meant = {of, last if IT.match(of) else of}  # a pronoun may be what was named last
        last = last if of in ("scene", "background") or IT.match(of) else of
        if hit := next((c for c in done if any(on_target(c, m, do) for m in meant)), None):
            hits += 1
            left.remove(hit)
        elif done:
            near += 1
            left.remove(done[0])
    missing = hits + near < len(asked)
    if hits == len(asked) and not left:
        return "right", False
    return ("partly" if hits or near else "wrong"), missing


def entries(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def kind_of(entry: dict[str, Any]) -> str:
    if entry["refuse"] == "must":
        return "must refuse"
    kinds = {c["do"] for c in entry["changes"]}
    return kinds.pop() if len(entry["changes"]) == 1 else "several"


def graded(rows: Iterable[dict[str, Any]]) -> list[tuple[dict[str, Any], str, bool, Instruction]]:
    rows = list(rows)
    made = zip(rows, read_all(each["text"] for each in rows))
    return [(entry, *grade(entry, read), read) for entry, read in made]


def main(args: list[str]) -> None:
    every = []
    for name in (each for each in args if not each.startswith("-")):
        rows = graded(entries(Path(name)))
        every += rows
        report(name, rows)
    kinds = dict.fromkeys(kind_of(row[0]) for row in every)
    for kind in kinds:
        report(kind, [row for row in every if kind_of(row[0]) == kind])
    report("all", every)
    why = Counter(row[3].refusal for row in every if row[1] == "wrongly refused")
    sys.stdout.write(f"wrongly refused by cause: {dict(why.most_common())}\n")
    if "-v" in args:
        for entry, result, silent, read in every:
            if result not in GOOD:
                keep = f" keep {entry.get('keep')}" if entry.get("keep") else ""
                meant = "; ".join(
                    f"{c['do']} {c.get('name', '')} of {c['of']} {c.get('sign', '')} "
                    f"{c.get('amount', '')} {c.get('to', '')}"
                    for c in entry["changes"]
                )
                sys.stdout.write(
                    f"{result}{' SILENT' * silent} [{read.refusal}] {entry['text']!r} -> "
                    f"{str(read)[:160]} | meant {meant}{keep}\n"
                )


def report(name: str, rows: Sequence[tuple[dict[str, Any], str, bool, Instruction]]) -> None:
    counts = Counter(row[1] for row in rows)
    good = sum(counts[each] for each in GOOD)
    silent = sum(row[2] for row in rows)
    told = ", ".join(
        f"{each} {counts[each]}"
        for each in (*GOOD, "partly", "wrongly refused", "wrong", "OPPOSITE")
    )
    sys.stdout.write(
        f"{Path(name).name:<14} {len(rows):>4} good {100 * good / max(len(rows), 1):5.1f} %  "
        f"{told}, silent {silent}\n"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
