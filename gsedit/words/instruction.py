"""Changes that a sentence asks for, in order, or why it is refused. Loads no torch."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

Target = Literal["subject", "background", "scene"]
Kind = Literal["material", "paint", "tone", "light", "look", "object", "growth"]
Side = Literal["left", "right", "front", "behind", "on", "beside", "forward", "back", "up", "down"]
MOST = {"tone": 5.0, "light": 2.0}
"""Largest shares that a tone and a light's strength grow by: colors six times as bright are white
or black nearly everywhere."""


@dataclass(frozen=True)
class Place:
    """Place that an object gets: a side of something, or a way to go."""

    side: Side
    of: str = ""
    """Phrase of what it is a side of, "it" for where it was; "" for a way to go."""
    units: bool = False
    """Whether the change's amount is in units of the scene's file, not a share of its size."""
    metres: bool = False
    """Whether it is in metres."""

    def __str__(self) -> str:
        words = SIDES[self.side] if self.of else WAYS.get(self.side, self.side)
        of = "the subject" if self.of == "it" else self.of
        return f"{words} {of}".rstrip()


SIDES = {
    "left": "to the left of", "right": "to the right of", "front": "in front of",
    "behind": "behind", "on": "on", "beside": "beside",
}  # fmt: skip
"""Words for a side of something."""
WAYS = {"left": "to the left", "right": "to the right"}
"""Words for a way to go that differ from its name."""


@dataclass(frozen=True)
class Change:
    """One change of one part of a scene."""

    target: Target
    """Part that changes: the scene's subject, all but the subject, or both."""
    kind: Kind
    name: str
    """Name of the material, paint, light or look; for tone brightness, contrast, saturation,
    warmth, shadows, highlights, sharpness, hue, grayscale, sepia or negative; for an object remove,
    scale, turn, move, copy or insert; for growth what grows, as snow."""
    color: str | None
    """Color as "#rrggbb"; None where the name alone says it. For hue the color to turn to."""
    amount: float | None
    """Signed share for tone: -0.3 is 30 % less; for hue a share of the full circle; for grayscale,
    sepia and negative the share in which they are mixed in, None for all; for light and
    growth the share that it is stronger than usual; for an object the share that it is larger, the
    share of the full circle that it turns counterclockwise as seen from above, or how far it moves
    in shares of its size (see Place.units)."""
    route: str
    """Way that does the change: "tone", "paint", "material", "light", "scenery" or "object";
    "style" where the painter draws it; "pix2pix" where only an editor of any sentence could."""
    phrase: str = ""
    """Words that name the object which changes, as "the red one"; for insert the scene's file; ""
    for what the target says."""
    place: Place | None = None
    """Place that the object gets."""
    keep: tuple[str, ...] = ()
    """Phrases of what stays as it is in the part that changes: "the bear but not its nose"."""

    @property
    def part(self) -> str:
        """Part that changes, in words."""
        kept = " and ".join(self.keep)
        return f"{self._part} but not {kept}" if kept else self._part

    @property
    def _part(self) -> str:
        if self.phrase not in ("", "it"):
            return f"everything but {self.phrase}" if self.target == "background" else self.phrase
        return "the whole scene" if self.target == "scene" else f"the {self.target}"

    def __str__(self) -> str:
        part = self.part
        color = f" ({self.color})" if self.color and self.color != self.name else ""
        match self.kind:
            case "tone":
                return f"{part} {_tone(self)}"
            case "paint":
                mixed = "a color " * self.name.startswith("between ")
                return f"{part} painted {mixed}{self.name}{color}"
            case "material" if self.name == "glow":
                return f"{part} glowing{color}"
            case "material":
                how = "with a" if self.name.endswith(" finish") else "made of"
                return f"{part} {how} {self.name}{color}"
            case "object":
                return f"{part} {_deed(self)}"
            case "growth":
                more = {True: "a thick", False: "a thin"}[(self.amount or 0) > 0]
                return f"{more if self.amount else 'a'} layer of {self.name} on {part}"
            case "look" if self.route == "style":
                return f"{part} in the style of {self.name}"
        name = re.sub(r"(?<!from) (above|below)$", r" from \1", self.name)
        more = "weaker" if (self.amount or 0) < 0 else "stronger"
        amount = "" if self.amount is None else f", {abs(self.amount):.0%} {more}"
        return f"{part} with the {self.kind}: {name}{color}{amount}".replace("%", " %")


MORE = {
    "brightness": ("brighter", "darker"), "warmth": ("warmer", "cooler"),
    "contrast": ("more contrast", "less contrast"),
    "saturation": ("more saturation", "less saturation"), "sharpness": ("sharper", "softer"),
    "shadows": ("lighter shadows", "deeper shadows"),
    "highlights": ("brighter highlights", "dimmer highlights"),
}  # fmt: skip
"""Words for more and for less of a tone."""


def _tone(change: Change) -> str:
    """A tone in words: "20 % darker"."""
    amount = change.amount or 0.0
    if change.name in MORE:
        words = MORE[change.name][amount < 0]
        return f"{'with ' * (' ' in words)}{abs(amount):.0%} {words}".replace("%", " %")
    if change.name == "hue":
        where = f"{'away from' if amount < 0 else 'toward'} {change.color}" if change.color else ""
        return f"with its hue turned {abs(amount) * 360:.0f} degrees {where}".rstrip()
    share = "" if change.amount is None else f"{amount:.0%} ".replace("%", " %")
    return f"in {share}{change.name}"


def _deed(change: Change) -> str:
    """Words for what is done with an object: "20 % larger", "moved to the left"."""
    amount, place = change.amount or 0.0, f" {change.place}" if change.place else ""
    if change.name == "copy" and change.place and change.place.of == change.phrase:
        place = f" {SIDES[change.place.side]} it"
    match change.name:
        case "copy" if amount > 1:
            words = f"copied {amount:.0f} times{place}"
        case "scale":
            words = f"{abs(amount):.0%} {'smaller' if amount < 0 else 'larger'}"
        case "turn":
            way = "" if abs(amount) == 0.5 else "clockwise" if amount < 0 else "counterclockwise"
            return f"turned by {abs(amount) * 360:.0f} degrees {way}".rstrip()
        case "move" if change.amount is not None:
            units = change.place is not None and change.place.units
            metres = change.place is not None and change.place.metres
            far = f"{amount:g} units" if units else f"{amount:.0%} of its size"
            far = f"{amount:.3g} m" if metres else far
            words = f"moved{place} by {far}"
        case _:
            words = f"{DONE[change.name]}{place}"
    return words.replace("%", " %")


DONE = {"remove": "removed", "move": "moved", "copy": "copied", "insert": "inserted"}
"""Words for what was done with an object."""


@dataclass(frozen=True)
class Instruction:
    """A sentence as it was read: what changes, or why nothing does."""

    text: str
    known: bool
    """Whether the changes are what the sentence asks for."""
    why: str
    """Reason and nearest thing that can be done, where it is refused; else how it was read."""
    changes: tuple[Change, ...]
    """In the order in which they are done; empty where the sentence is refused."""
    refusal: str = ""
    """Kind of refusal, such as "negation"; "" where it is known."""
    unread: tuple[str, ...] = ()
    """Words of a request or an exception that nothing was made of."""

    def as_json(self) -> str:
        """One line of JSON with the keys known, why, changes and unread."""
        changes = [asdict(change) for change in self.changes]
        record = {"known": self.known, "why": self.why, "changes": changes, "unread": self.unread}
        return json.dumps(record)

    def __str__(self) -> str:
        if not self.known:
            return self.why
        left = ", ".join(map(repr, self.unread))
        return "; ".join(map(str, self.changes)) + f" (not read: {left})" * bool(left)


# ---- a change as a sentence that reads back as itself -------------------------------------------


def sentence_of(changes: Sequence[Change]) -> str | None:
    """A sentence for changes of tones, paints, materials, sizes, turns and growths; None where one
    of them is of another kind. Few sentences read back as others, such as those of materials whose
    name leaves their color out: compare what `read_instruction` makes of it."""
    clauses = [clause_of(change) for change in changes]
    return None if None in clauses else ", and ".join(filter(None, clauses))


def clause_of(change: Change) -> str | None:
    """One change as a clause: "make the subject 20 % darker"; None for other kinds."""
    part = change.part
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
        case "material", name if name.endswith(" finish"):
            return f"give {part} a {name}"
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
