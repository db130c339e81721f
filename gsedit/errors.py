"""Errors that a user can cause, by kind. A message names the file, the place and the next move."""

from __future__ import annotations

from pathlib import Path

MOVES, ON_PAGE = {"": ""}, {"": ""}
"""Next moves by code, in the words of the command line and in those of the page: see moves.txt."""
for _row in Path(__file__).with_name("moves.txt").read_text("utf-8").splitlines():
    if _row and _row[0] != "#":
        _code, _said, _shown = _row.split("|")
        MOVES[_code.strip()], ON_PAGE[_code.strip()] = _said, _said if _shown == "=" else _shown


class Said(str):
    """A sentence for a person: what is so, and the next move by its code in MOVES.

    It is the text that a terminal shows; text + Said is a Said, whose move stays known.
    """

    what: str
    move: str
    values: dict[str, str]
    """Values of the names in the move's words."""
    offers: tuple[str, ...]
    """Words to say in place of the words `of` of a sentence; of all of it where `of` is ""."""
    of: str

    def __new__(
        cls, what: str, move: str = "", offers: tuple[str, ...] = (), of: str = "", **values: str
    ) -> Said:
        said = super().__new__(cls, what + MOVES[move].format(**values))
        said.what, said.move, said.values, said.offers, said.of = what, move, values, offers, of
        return said

    def __radd__(self, before: str) -> Said:
        return self.worded(before + self.what)

    def worded(self, what: str) -> Said:
        """Another sentence with this one's next move and offers."""
        return Said(what, self.move, self.offers, self.of, **self.values)


class GseditError(Exception):
    """Anything that a user's input or request caused."""

    @property
    def said(self) -> Said:
        """The message with its next move, where that has a code."""
        message = self.args[0] if self.args else ""
        return message if isinstance(message, Said) else Said(str(self))


class UsageError(GseditError):
    """The request itself cannot be met: an option, an instruction, a combination (exit code 2)."""


class InputError(GseditError):
    """A file or folder cannot be read as what it should be (exit code 3)."""


def on_page(error: Exception) -> Said:
    """The message of an error in the words of the page, in one line."""
    said = error.said if isinstance(error, GseditError) else Said(str(error))
    told = " ".join((said.what + ON_PAGE[said.move].format(**said.values)).split())
    return Said(told, offers=said.offers, of=said.of)
