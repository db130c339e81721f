"""Changes that a program writes as JSON in place of a sentence. Loads no torch."""

from __future__ import annotations

import json
from typing import Any, get_args

from gsedit.errors import UsageError
from gsedit.words import lexicon
from gsedit.words.colors import hexadecimal
from gsedit.words.instruction import MOST, Change, Instruction, Kind, Place, Side, Target
from gsedit.words.lexicon import routed
from gsedit.words.names import TABLE, light_of

NAMES = {
    "tone": ("brightness", "contrast", "saturation", "warmth", "shadows", "highlights",
             "sharpness", "hue", "grayscale", "sepia", "negative"),
    "object": ("remove", "scale", "turn", "move", "copy", "insert"),
    "growth": tuple(TABLE["growths"]),
}  # fmt: skip
"""Names of each kind that has few."""
FIELDS = {"target", "kind", "name", "color", "amount", "phrase", "place", "keep", "route"}
MOST_CHANGES = 20


def is_written(text: str) -> bool:
    """Whether a text is JSON in place of a sentence."""
    return text.lstrip().startswith("{") and '"changes"' in text


def written(text: str) -> Instruction:
    """Changes of JSON such as {"changes": [{"target": "subject", "kind": "material", "name":
    "gold", "phrase": "the bear"}]}; as `Instruction.as_json` writes them.

    Raises UsageError that names the field which is wrong.
    """
    try:
        rows = json.loads(text)["changes"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(f"the changes are no JSON with a list 'changes': {error}") from None
    if not isinstance(rows, list) or not 0 < len(rows) <= MOST_CHANGES:
        raise UsageError(f"'changes' is no list of 1 to {MOST_CHANGES} changes")
    changes = tuple(_change(row, f"changes[{at}]") for at, row in enumerate(rows))
    return Instruction(text, True, "; ".join(map(str, changes)), changes)


def _change(row: Any, place: str) -> Change:
    if not isinstance(row, dict) or (odd := set(row) - FIELDS):
        raise UsageError(f"{place} has {sorted(odd) if isinstance(row, dict) else 'no fields'}; "
                         f"a change has {sorted(FIELDS)}")  # fmt: skip
    target = _one_of(row, "target", get_args(Target), place)
    kind = _one_of(row, "kind", get_args(Kind), place)
    name = _one_of(row, "name", NAMES.get(kind, ()), place)
    color, amount = row.get("color"), row.get("amount")
    if color is not None and (not isinstance(color, str) or hexadecimal(color) != color):
        raise UsageError(f"{place}.color is {color!r}: write it as '#c04000'")
    number = isinstance(amount, (int, float)) and not isinstance(amount, bool)
    most = MOST.get(kind, 20.0)
    if amount is not None and not (number and -1 <= amount <= most):
        raise UsageError(f"{place}.amount is {amount!r}: write a number from -1 to {most:g}")
    if kind == "paint" and color is None:
        raise UsageError(f"{place} is a paint without a color: write 'color' as '#c04000'")
    amount = None if amount is None else float(amount)
    keep = row.get("keep") or ()
    if not isinstance(keep, (list, tuple)) or not all(isinstance(each, str) for each in keep):
        raise UsageError(f"{place}.keep is no list of phrases")
    phrase = str(row.get("phrase") or "")
    return routed(
        Change(target, kind, name, color, amount, "", phrase, _place(row.get("place"), place),
               tuple(keep))  # type: ignore[arg-type]
    )  # fmt: skip


def _one_of(row: dict[str, Any], field: str, known: tuple[str, ...], place: str) -> Any:
    value = row.get(field)
    if not isinstance(value, str) or not value or (known and value not in known):
        told = ", ".join(known) or "a name of gsedit list looks"
        raise UsageError(f"{place}.{field} is {value!r}: choose {told}")
    lit = field == "name" and row.get("kind") == "light"
    if lit and light_of(value) not in lexicon.names("light"):
        raise UsageError(f"{place}.name is {value!r}: choose a light of gsedit list looks")
    return value


def _place(row: Any, where: str) -> Place | None:
    if row is None:
        return None
    if not isinstance(row, dict) or row.get("side") not in get_args(Side):
        raise UsageError(f"{where}.place has no side of {', '.join(get_args(Side))}")
    units, metres = bool(row.get("units")), bool(row.get("metres"))
    return Place(row["side"], str(row.get("of") or ""), units, metres)
