"""What a verb prints: messages to stderr, its result to stdout as text or as one JSON line.

Of several ranks the first prints.
"""

from __future__ import annotations

import json
from typing import Any

import typer

from .ranks import is_first


def print_message(text: str) -> None:
    """Print lines for a person, on stderr. Not through rich: it would fold a long line."""
    if is_first():
        typer.echo(text, err=True)


def print_result(record: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print the result of a verb on stdout: `record` as a JSON line, or else `text`."""
    if as_json:
        print_json("result", record)
    elif is_first():
        typer.echo(text)


def print_json(kind: str, record: Any) -> None:
    """Print a record (a mapping or a dataclass) as one JSON line, with its kind under `type`."""
    if not is_first():
        return
    from gsedit.reports.json_lines import plain

    typer.echo(json.dumps({"type": kind, **plain(record)}, allow_nan=False))
