"""Errors that a user can cause, by kind. A message names the file, the place and the next move."""

from __future__ import annotations

SHOWN = "gsedit render SCENE --region ..."
ANY = "--editor pix2pix --model FOLDER"
MOVES = {
    "": "",
    "select": ": mark it with --region, and say 'it'",
    "select-change": f": name what should change with --region, and look at it with {SHOWN}",
    "select-object": f": name the object with --region, and look at it with {SHOWN}",
    "select-less": ": mark the object with a smaller --region; gsedit transform turns, moves and "
    "scales a whole scene",
    "select-part": ": mark it with --region and say what changes there, or name the subject, the "
    "background or the whole scene",
    "select-kind": ", or say --phrase 'the {kind}'",
    "look": f": look at what is selected with {SHOWN}",
    "look-region": f": look at it with {SHOWN}",
    "objects": "; see them with gsedit select SCENE --objects",
    "objects-masks": "; see them with gsedit select SCENE --objects, or bring a network by --masks",
    "point": ": point at it with --at VIEW:X,Y and say 'remove it', or save it by a name with "
    "gsedit select ... --as NAME, and say that",
    "any-sentence": f"; for any sentence: {ANY}",
    "unread": " Add --accept-unread, or say it in other words",
    "styles": f" (gsedit list styles), and --like takes a picture's. For any sentence: {ANY}",
    "like": ": add --like PICTURE",
    "unlike": ": leave --like out, or say 'in the style of this picture'",
    "undrawn": ": leave out the options of what a 2D editor draws, or name one that draws it all, "
    f"as in {ANY}",
    "focal": ": name it with --focal (a phone's main camera: 26), or use the camera's own files "
    "with EXIF",
    "memory": ": try a smaller --size, or close other programs",
    "memory-again": ": try a smaller --size, and run the command again to go on",
    "begin-again": ": go on with that version, or leave --resume out and add -f to start again",
    "repeat": ". Repeat that command with --resume, or leave --resume out and add -f to start "
    "again",
    "report": "; rerun with --debug and report what it shows",
}
"""Next moves by code, in the words of the command line; the page has words of its own for
those that name options (gsedit.app.moves)."""


class Said(str):
    """A sentence for a person: what is so, and the next move by its code in MOVES.

    It is the text that a terminal shows; text + Said is a Said, whose move stays known.
    """

    what: str
    move: str
    values: dict[str, str]
    """Values of the names in the move's words."""

    def __new__(cls, what: str, move: str = "", **values: str) -> Said:
        said = super().__new__(cls, what + MOVES[move].format(**values))
        said.what, said.move, said.values = what, move, values
        return said

    def __radd__(self, before: str) -> Said:
        return Said(before + self.what, self.move, **self.values)


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
