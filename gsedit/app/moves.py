"""Next moves in the words of the page, where nobody types options."""

from __future__ import annotations

from gsedit.errors import MOVES, GseditError, Said

ON_PAGE = {
    "select": ": select it by a click, and say 'it'",
    "select-change": ": select what should change by a click",
    "select-object": ": select the object by a click",
    "select-less": ": select less; the handles under Tools move a whole scene",
    "select-part": ": select it by a click and say what changes there, or name the subject, the "
    "background or the whole scene",
    "select-kind": ", or say 'the {kind}'",
    "look": "",
    "look-region": "",
    "objects": "; or click on it",
    "objects-masks": "; or click on it",
    "point": ": select it by a click and say 'remove it'",
    "any-sentence": "",
    "unread": " Say it in other words, or leave them out",
    "styles": "",
    "like": ": load one",
    "unlike": "",
    "undrawn": "",
    "focal": ": use the camera's own files with EXIF",
    "memory": ": close other programs",
    "memory-again": ": close other programs, and make the scene again: it goes on",
    "begin-again": ": say the sentence again",
    "repeat": ". Say the sentence again",
    "report": "; what was done before is kept",
}
"""By the codes of gsedit.errors.MOVES."""


def on_page(error: Exception) -> str:
    """The message of an error in the words of the page, in one line."""
    said = error.said if isinstance(error, GseditError) else Said(str(error))
    words = ON_PAGE.get(said.move, MOVES[said.move])
    return " ".join((said.what + words.format(**said.values)).split())
