"""Print messages to stderr, and results to stdout as text or as one JSON line."""

from __future__ import annotations

import json
import re
from contextvars import ContextVar
from typing import Any

import typer

as_json: ContextVar[bool] = ContextVar("as_json", default=False)
"""Whether the command that runs prints JSON lines: --json."""
_CONTROL = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Characters that a terminal obeys instead of showing: all control characters but tabs and line
ends, and those that turn the direction of writing."""


def shown(text: str) -> str:
    """The text as a terminal may get it: names from files cannot move its cursor or set its title,
    their control characters appear as \\x1b."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


def print_message(text: str) -> None:
    """Print lines for a person, on stderr. Not through rich: it would fold a long line."""
    typer.echo(shown(text), err=True)


def print_result(record: dict[str, Any], text: str) -> None:
    """Print the result of a verb on stdout: with --json `record` as a JSON line, else `text`."""
    if as_json.get():
        print_json("result", record)
    else:
        typer.echo(shown(text))


def print_json(kind: str, record: Any) -> None:
    """Print a record (a mapping or a dataclass) as one JSON line, with its kind under `type`."""
    from gsedit.run.json_lines import plain

    typer.echo(json.dumps({"type": kind, **plain(record)}, allow_nan=False))
