"""Meaning of an instruction, as it was understood. Loads no torch."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.words.looks import LOOKS, Look, Scope


@dataclass(frozen=True)
class ScoredLook:
    """A look and how sure it is."""

    name: str
    score: float
    """Probability among the looks of its scope and none of them, in [0, 1]."""

    @property
    def look(self) -> Look:
        return LOOKS[self.name]


@dataclass(frozen=True)
class Understanding:
    """Meaning of an instruction, as it was understood."""

    looks: tuple[ScoredLook, ...]
    """The subject's looks, then the scene's. The nearest one where none is known and one may be
    guessed."""
    known: bool
    """Whether these looks are what the sentence asks for."""
    why: str = ""
    """The changes in words; where it is not known the reason, and none may be guessed where there
    are no looks."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(each.name for each in self.looks)

    @property
    def scope(self) -> Scope:
        """Scope of the edit: "subject" if only its look is asked for, else "scene"."""
        return "scene" if any(each.look.scope == "scene" for each in self.looks) else "subject"

    @property
    def wordings(self) -> tuple[str, ...]:
        """Wordings that the editor `small` is given, one pass after the other."""
        return tuple(each.look.wording for each in self.looks)

    def __str__(self) -> str:
        return " + ".join(self.names)


def not_understood(editor: str, prompt: str, nearest: Understanding) -> str:
    """Why an editor that knows only these looks refuses an instruction, and what to do instead."""
    if not nearest.looks:
        return f"{prompt.strip()!r}: " + nearest.why
    guess = f"{nearest} ({nearest.looks[0].score:.2f})"
    return (
        f"{prompt.strip()!r} asks for no look that {editor} knows; the nearest is {guess}. "
        f"{editor} changes material, colour, weather, season, light and style (see "
        "gsedit list looks); it cannot add, remove, move or reshape anything. Say it in other "
        "words, add --guess for the nearest look, or use an editor that follows any sentence: "
        "--editor pix2pix --model FOLDER, or --editor command --run PROGRAM"
    )
