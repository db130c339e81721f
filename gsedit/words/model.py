"""Changes of a sentence as a language model of the user's writes them, over the chat completions
that llama.cpp, ollama and others serve. Loads no torch."""

from __future__ import annotations

import json
from http.client import HTTPException
from typing import Any, get_args
from urllib.request import Request, urlopen

from gsedit.errors import UsageError
from gsedit.words import lexicon
from gsedit.words.instruction import Kind, Side, Target
from gsedit.words.written import NAMES, written

SECONDS = 120.0
"""Time that a model may take to answer: small ones need half of it on a slow processor."""
MOST_BYTES = 1 << 20
"""Length of an answer at most."""
LISTED = {**NAMES, **lexicon.looks()}
"""Names that a model is told, by kind."""
TASK = (
    "You turn one sentence about a captured 3D scene into changes, as JSON. Names by kind: "
    + "; ".join(f"{kind}: {', '.join(names)}" for kind, names in LISTED.items() if names)
    + ". Names of scenery and style have the kind look. A paint has any name, and a color "
    "#rrggbb. phrase: the thing that changes in the words of the sentence, '' for the main subject "
    "or the whole scene; keep: phrases of what the sentence says stays. amount: 0.2 is 20 % more, "
    "-0.5 half as much; of a turn the share of the full circle, counterclockwise. 'All but X' has "
    "the target background and the phrase X. Give no change that the sentence denies; where "
    "nothing can be done, give none."
)


def _nullable(kind: str) -> dict[str, Any]:
    return {"type": [kind, "null"]}


PLACE = {
    "type": ["object", "null"],
    "properties": {
        "side": {"enum": get_args(Side)}, "of": {"type": "string"}, "units": {"type": "boolean"},
        "metres": {"type": "boolean"},
    },
    "required": ["side"],
}  # fmt: skip
CHANGE = {
    "type": "object",
    "properties": {
        "target": {"enum": get_args(Target)}, "kind": {"enum": get_args(Kind)},
        "name": {"type": "string"}, "color": _nullable("string"), "amount": _nullable("number"),
        "phrase": {"type": "string"}, "keep": {"type": "array", "items": {"type": "string"}},
        "place": PLACE,
    },
    "required": ["target", "kind", "name"], "additionalProperties": False,
}  # fmt: skip
SCHEMA = {
    "type": "object", "required": ["changes"], "additionalProperties": False,
    "properties": {"changes": {"type": "array", "items": CHANGE}},
}  # fmt: skip
"""JSON schema of the changes that stand in place of a sentence."""


def changes_by_model(sentence: str, url: str, seconds: float = SECONDS) -> str:
    """The JSON of changes that the language model at `url` reads in a sentence.

    `url` is that of a server, as "http://localhost:8080", or of its chat completions; the sentence
    is sent there and nowhere else. Raises UsageError where it does not answer within `seconds`, or
    answers no changes of the schema, or loses what the sentence says stays.
    """
    from gsedit.words.marks.heard import stays_unheard

    where = f"the reader {url!r}"
    try:
        text = _asked(sentence, url, seconds)
    except (OSError, ValueError, KeyError, IndexError, TypeError, HTTPException) as error:
        told = (
            "timed out" if isinstance(error, TimeoutError) else str(error) or type(error).__name__
        )
        raise UsageError(f"{where} gave no answer that is a chat completion: {told}; leave "
                         "--reader out to read the sentence here") from None  # fmt: skip
    try:
        read = written(text)
    except UsageError as error:
        raise UsageError(f"{where} answered {text[:80]!r}: {error}") from None
    if stopped := stays_unheard(sentence, read.changes):
        raise UsageError(f"{where} lost what stays ({stopped!r}): it read {read.why}")
    return text


def _asked(sentence: str, url: str, seconds: float) -> str:
    """Content of the answer to a sentence."""
    end = "/chat/completions"
    if not url.startswith(("http://", "https://")):
        raise ValueError("it is no http address")
    address = (
        url if url.rstrip("/").endswith(end) else f"{url.rstrip('/').removesuffix('/v1')}/v1{end}"
    )
    form = {"type": "json_schema", "json_schema": {"name": "changes", "schema": SCHEMA}}
    body = {
        "messages": [{"role": "system", "content": TASK}, {"role": "user", "content": sentence}],
        "temperature": 0, "response_format": form,
    }  # fmt: skip
    request = Request(address, json.dumps(body).encode(), {"Content-Type": "application/json"})
    with urlopen(request, timeout=seconds) as answer:
        found = json.loads(answer.read(MOST_BYTES))
    return str(found["choices"][0]["message"]["content"])
