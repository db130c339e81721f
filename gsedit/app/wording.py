"""Messages of the command line in the words of the page, where nobody types options."""

from __future__ import annotations

import re

_MARK = r"(?:mark|name) (it|the object|what (?:should|may) change) with --region"
_LOOK = r"[;,:]? ?(?:and )?look at (?:it|what is selected) with gsedit render SCENE --region \.\.\."
_PHOTOS = "use the camera's own files"
WORDS = tuple(
    (re.compile(said), on_page)
    for said, on_page in (
        (_LOOK, ""),
        (_MARK, r"select \1 by a click"),
        (r" \(gsedit list looks\)", r": say another, as “a pencil sketch”"),
        (r"[;.,:]? [Ff]or any sentence: --editor pix2pix --model FOLDER.*", ""),
        (r"point at it with --at VIEW:X,Y and say 'remove it', or save it .* and say that",
         "select it by a click and say 'remove it'"),
        (r"or say --phrase ('the \w+')", r"or select \1 by words"),
        (r" \(--masks\)", ""),
        (r"; see them with gsedit select SCENE --objects", "; or click on it"),
        (r" \(--no-retries: not\)", ""),
        (r", or compare every pair with --matching exhaustive", ""),
        (r"name it with --focal \(.*?\), or use the camera's own files", _PHOTOS),
        (r"try a smaller --size, and run the command again to go on",
         "close other programs, and make the scene again: it goes on"),
        (r"go on with that version, or leave --resume out and add -f to start again",
         "say the sentence again"),
        (r"Repeat that command with --resume, or leave --resume out and add -f to start again",
         "Say the sentence again"),
        (r"; rerun with --debug and report what it shows", "; what was done before is kept"),
        (r"go on with the same command", "make the scene again: it goes on"),
    )
)  # fmt: skip
"""Pairs: what the command line says, and what the page says in its place."""


def on_page(text: str) -> str:
    """A message of the command line in the words of the page: what is marked there is selected."""
    for said, there in WORDS:
        text = said.sub(there, text)
    return text
