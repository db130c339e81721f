"""A change as a sentence that reads back as itself, so that an amount or a color set by hand is
still an instruction that a person can read, keep and repeat. Loads no torch."""

from __future__ import annotations

from collections.abc import Sequence

from gsedit.words.instruction import MORE, Change
from gsedit.words.phrases import IT


def sentence_of(changes: Sequence[Change]) -> str | None:
    """A sentence for changes of tones, paints, materials, sizes, turns and growths; None where one
    of them is of another kind. Few sentences read back as others, such as those of materials whose
    name leaves their color out: compare what `read_called` makes of it."""
    clauses = [clause_of(change) for change in changes]
    return None if None in clauses else ", and ".join(filter(None, clauses))


def clause_of(change: Change) -> str | None:
    """One change as a clause: "make the subject 20 % darker"; None for other kinds."""
    part = _part(change)
    amount = change.amount or 0.0
    share = f"{100 * abs(amount):.6g} %"
    match change.kind, change.name:
        case "tone", name if name in MORE and change.amount is not None:
            words = MORE[name][amount < 0]
            return (
                f"give {part} {share} {words}" if " " in words else f"make {part} {share} {words}"
            )
        case "paint", name if change.color is not None and not name.startswith("between "):
            return f"paint {part} {name}"
        case "material", name:
            return f"make {part} {name}" if change.phrase else f"turn {part} into {name}"
        case "object", "scale" if change.amount is not None:
            return f"make {part} {share} {'smaller' if amount < 0 else 'larger'}"
        case "object", "turn" if change.amount is not None:
            way = "clockwise" if amount < 0 else "counterclockwise"
            return f"turn {part} by {360 * abs(amount):.6g} degrees {way}"
        case "growth", name:
            thick = f"{share} {'thinner' if amount < 0 else 'thicker'} " if amount else ""
            where = "" if change.target == "scene" else f" on {part}"
            return f"put a {thick}layer of {name}{where}"
    return None


def _part(change: Change) -> str:
    if change.phrase not in ("", IT):
        return f"everything but {change.phrase}" if change.target == "background" else change.phrase
    return "the whole scene" if change.target == "scene" else f"the {change.target}"
