"""Grader of read sentences against a file of them: counts, and opposites."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch

from gsedit.words.colors import distance, lab_of
from gsedit.words.instruction import Change, Instruction
from gsedit.words.lexicon import style_words
from gsedit.words.marks import heard, network
from gsedit.words.marks.marked import pieces, spelled, told
from gsedit.words.marks.values import plainly
from gsedit.words.phrases import DEFINITE
from gsedit.words.read import read_instruction
from gsedit.words.scan import scanned

SAME = {
    "aluminium": "aluminum", "fibre": "fiber", "grey": "gray", "rusted": "rust", "rusty": "rust",
    "oak": "wood",
    "comic": "cartoon", "mist": "fog", "candle": "candlelight",
    "overcast": "cloudy", "midday": "noon",
}  # fmt: skip
"""Words of one meaning."""
MODES = {"grayscale": ("saturation", -1.0), "black and white": ("saturation", -1.0)}


def read_all(texts: Iterable[str]) -> list[Instruction]:
    """Every text as it is read, in a third of the time: the network marks those of as many pieces
    together, which changes no more than rounding. It marks a text by itself that is not foreseen.
    """
    texts, alike, made = list(texts), dict[int, dict[str, Any]](), dict[str, Any]()
    for each in dict.fromkeys(spelled(plainly(text)) for text in texts):
        alike.setdefault(len(pieces(each).ids), {})[each] = pieces(each)
    net, values = network.trained()
    for cuts in alike.values():
        ids = torch.tensor([cut.ids for cut in cuts.values()])
        with torch.inference_mode():
            scores = net(ids, torch.ones_like(ids, dtype=torch.bool))
        for row, (each, cut) in enumerate(cuts.items()):
            made[each] = told(cut, {name: some[row] for name, some in scores.items()}, values)
    alone = heard.marked
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(heard, "marked", lambda text: made.get(text) or alone(text))
        return [read_instruction(text) for text in texts]


def sign_of(change: dict[str, Any]) -> int:
    """Sign that a made tone has; +1 without an amount."""
    return 1 if change["amount"] is None or change["amount"] > 0 else -1


def mode(change: dict[str, Any]) -> dict[str, Any]:
    """A change to gray as full desaturation, whatever it is called."""
    if change["kind"] in ("tone", "look") and change["name"] in MODES:
        name, amount = MODES[change["name"]]
        return {**change, "kind": "tone", "name": name, "amount": amount, "sign": -1}
    return change


def tokens(name: str) -> set[str]:
    return {SAME.get(word, word) for word in re.findall(r"[a-z]+", name.lower())}


def plain(made: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """A made change whose noun alone is the subject or the background that was asked for: the
    older files have no phrase for looks of these."""
    phrase = made.get("phrase", "")
    if made["kind"] == "object" or asked.get("phrase") or not phrase or asked["kind"] == "object":
        return made
    words = [word for word in scanned(phrase) if word.text not in DEFINITE]
    if words[-1].kind in ("ground", "place") and asked["target"] != "subject":
        return {**made, "phrase": "", "target": asked["target"]}
    return {**made, "phrase": ""}


def names_part(phrase: str) -> bool:
    """Whether a phrase names a part of a thing, as "the ears"."""
    return any(word.kind == "part" or word.text == "head" for word in scanned(phrase))


def bare(phrase: str) -> str:
    """A phrase without its article."""
    return phrase.removeprefix("the ")


def is_for_scene(made: dict[str, Any]) -> bool:
    """Whether only a scene can tell that a change is not done: metres without a scale."""
    several = made["name"] == "copy" and (made["amount"] or 1) > 1
    return several or bool(made["place"] and made["place"].get("metres"))


def grounded(made: dict[str, Any]) -> dict[str, Any]:
    """A change of the ground by its name as one of the background."""
    words = scanned(made["phrase"])
    ground = bool(words) and words[-1].kind == "ground" and made["kind"] not in ("object", "growth")
    return {**made, "phrase": "", "target": "background"} if ground else made


def agrees(made: dict[str, Any], asked: dict[str, Any]) -> bool:
    """Whether one made change is one that was asked for."""
    made, asked = mode(plain(made, asked)), mode(asked)
    if (made["target"], made["kind"]) != (asked["target"], asked["kind"]):
        lit = {made["kind"], asked["kind"]} == {"light", "look"}
        if not (lit and made["target"] == asked["target"]):
            return False
    if made["kind"] == "tone":
        return tone_agrees(made, asked)
    if made["kind"] == "paint":
        finish = asked.get("finish")
        return distance(made["color"], asked["color"]) <= 15 and (
            not finish or finish in made["name"]
        )
    if bare(made.get("phrase", "")) != bare(asked.get("phrase", "")):
        return False
    if made["kind"] in ("object", "growth"):
        return acts_alike(made, asked)
    if made["route"] == "style" and style_words().get(asked["name"]) == made["name"]:
        return True
    one, other = tokens(made["name"]), tokens(asked["name"])
    return one <= other or other <= one


def acts_alike(made: dict[str, Any], asked: dict[str, Any]) -> bool:
    """Whether two actions on an object are of one kind, by one amount, to one place."""
    amounts = [float("inf") if each["amount"] is None else each["amount"] for each in (made, asked)]
    near = amounts[0] == amounts[1] or abs(amounts[0] - amounts[1]) < 0.02
    place = made["place"] and {
        key: each for key, each in made["place"].items() if each or key != "metres"
    }
    return near and made["name"] == asked["name"] and place == asked["place"]


def tone_agrees(made: dict[str, Any], asked: dict[str, Any]) -> bool:
    if made["name"] != asked["name"] or (asked.get("sign") or 1) != sign_of(made):
        return False
    if asked.get("amount") is not None and abs((made["amount"] or 0) - asked["amount"]) > 0.02:
        return False
    return not asked.get("color") or (
        bool(made["color"]) and distance(made["color"], asked["color"]) < 60
    )


def fulfils(made: list[dict[str, Any]], asked: list[dict[str, Any]]) -> bool:
    """Whether changes are those that were asked for, in any order."""
    left = list(asked)
    for change in made:
        match = next((each for each in left if agrees(change, each)), None)
        if match is None:
            return False
        left.remove(match)
    return not left


def opposes(made: dict[str, Any], pattern: dict[str, Any]) -> bool:
    """Whether a made change matches every key of a pattern of what is plainly wrong."""
    rows = {**made, "sign": sign_of(made)}
    for key, value in pattern.items():
        if key == "toward":
            color = made["color"]
            if made["name"] != "hue" or not color:
                return False
            toward = float(lab_of(color)[1:] @ lab_of(value)[1:]) * sign_of(made) > 0
            if not toward:
                return False
        elif key == "color":
            if not made["color"] or distance(made["color"], value) > 15:
                return False
        elif key == "name" and made["kind"] == "material":
            if not tokens(value) <= tokens(made["name"]):
                return False
        elif rows.get(key) != value:
            return False
    return True


def grade(entry: dict[str, Any], changes: tuple[Change, ...], known: bool) -> str:
    """One of right, refused rightly, wrong, opposite; a wrong refusal is wrong."""
    made = [asdict(change) for change in changes]
    if (
        not entry["known"]
        and made
        and all(names_part(each["phrase"]) or is_for_scene(each) for each in made)
    ):
        return "refused rightly"  # the part is named: it is found in a scene, or refused there
    made = [grounded(each) for each in made]
    if any(opposes(change, pattern) for change in made for pattern in entry["opposite"]):
        return "opposite"
    if not entry["known"]:
        return "wrong" if known else "refused rightly"
    asked = [entry["changes"], *entry["alternatives"]]
    return "right" if known and any(fulfils(made, each) for each in asked) else "wrong"


def graded(path: Path) -> tuple[Counter[str], list[tuple[str, str]]]:
    """(counts, sentences that are not right with their grade) of a file."""
    total, missed = Counter[str](), list[tuple[str, str]]()
    entries = json.loads(path.read_text(encoding="utf-8"))
    for entry, read in zip(entries, read_all(each["text"] for each in entries)):
        result = grade(entry, read.changes, read.known)
        total[result] += 1
        if result in ("wrong", "opposite"):
            missed.append((result, f"{entry['text']!r} -> {read}"))
    return total, missed


if __name__ == "__main__":
    counts, misses = graded(Path(sys.argv[1]))
    lines = [str(dict(counts))]
    if "-v" in sys.argv:
        lines += [f"{result}: {text}" for result, text in misses]
    sys.stdout.write("\n".join(lines) + "\n")
