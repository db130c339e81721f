"""Progress of reading a sentence, clause by clause."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.words.instruction import Change


class Refused(Exception):
    """Kind of refusal of a sentence."""


@dataclass
class Reading:
    """Changes and parts that the clauses before have named."""

    changes: list[Change]
    target: str | None = None
    kept: str | None = None
    direction: int = 0
    negated: bool = False
