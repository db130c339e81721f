"""Measurements as JSON lines, with their provenance: when, where, and by which code."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TypeVar

import torch

from gsedit.bench.results import commit, machine
from gsedit.run.events import Event
from gsedit.run.json_lines import Journal


@dataclass(frozen=True)
class Provenance:
    """Fields that every measurement has."""

    threads: int
    """Number of torch's threads."""
    commit: str
    machine: str
    date: str
    """Date and time, ISO 8601, UTC."""

    def __str__(self) -> str:
        return f"{self.date}, commit {self.commit}, {self.machine}, {self.threads} threads."


def provenance() -> Provenance:
    """Provenance of a measurement that is taken now."""
    date = datetime.now(timezone.utc).isoformat(timespec="seconds")
    return Provenance(torch.get_num_threads(), commit(), machine(), date)


Measurement = TypeVar("Measurement")


def write_measurements(
    items: Iterable[Event | Measurement], path: Path, measurements: list[Measurement]
) -> Iterator[Event | Measurement]:
    """Pass on events and measurements; each measurement is first appended to the list, and to the
    file as a JSON line, so that an interruption loses none.

    The first measurement replaces a file that is there already.
    """
    journal = Journal(path, records=measurements)
    for item in items:
        if not isinstance(item, Event):
            journal.write(item)
        yield item
