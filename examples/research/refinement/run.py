"""Edit the extreme cases one by one: finite and how far, or refused with a message."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch

from gsedit.bench.results import markdown_table, write_measurements, write_text
from gsedit.editing.edit import edit_steps
from gsedit.editing.session.result import EditResult
from gsedit.editing.strategies.single_pass import SinglePass
from gsedit.errors import GseditError
from gsedit.measures.metrics import psnr
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer.scene import Gaussians
from research.refinement.cases import CASES, Case, Editor, scaled_rates

ROWS, TABLE = "refinement.jsonl", "refinement.md"
STEPS = 20
"""Fitting steps a round."""


@dataclass(frozen=True)
class Row:
    """Result of one case."""

    name: str
    why: str
    outcome: str
    """finite, not finite, or refused."""
    message: str = ""
    """Message of the refusal."""
    before: float | None = None
    """Mean PSNR of the unedited scene to the targets, dB."""
    after: float | None = None
    """Mean PSNR of the edited scene to the targets, dB; infinite for equal pictures."""
    largest: float | None = None
    """Largest change of a color coefficient, opacity (logit) or position."""
    seconds: float = 0.0


def measurements(*, quick: bool, steps: int = STEPS) -> Iterator[Row]:
    """All cases, in a quick run without those that take minutes."""
    yield from (measure(case, steps) for case in CASES if not (quick and case.long))


def measure(case: Case, steps: int = STEPS) -> Row:
    """Edit one case. The renderer refuses scenes by ValueError, everything else by GseditError."""
    stopwatch = Stopwatch()
    try:
        scene, data = case.make()
        with scaled_rates(case.rates):
            items = edit_steps(
                scene,
                "exchange red and blue",
                editor=Editor(case.change),
                generator=torch.Generator().manual_seed(0),
                dataset=data,
                settings=case.settings(),
                strategy=SinglePass(steps),
            )
            result = deque(items, maxlen=1).pop()
    except (GseditError, ValueError) as error:
        return Row(case.name, case.why, "refused", str(error), seconds=stopwatch.seconds)
    assert isinstance(result, EditResult)
    return _ended(case, scene, result, stopwatch.seconds)


def _ended(case: Case, scene: Gaussians, result: EditResult, seconds: float) -> Row:
    edited = result.scene
    finite = all(bool(value.isfinite().all()) for value in vars(edited).values())
    pairs = [(vars(scene)[name], vars(edited)[name]) for name in vars(edited)]
    change = max(float((a - b).abs().max()) for a, b in pairs)
    befores, afters = (
        [psnr(v.image, t.image) for v, t in zip(views, result.targets)]
        for views in (result.originals, result.finals)
    )
    return Row(
        case.name,
        case.why,
        "finite" if finite else "not finite",
        before=sum(befores) / len(befores),
        after=sum(afters) / len(afters),
        largest=change,
        seconds=seconds,
    )


def to_folder(folder: Path, *, quick: bool) -> Iterator[Event | Row]:
    """All cases, written to a folder: ROWS meanwhile, then TABLE."""
    rows: list[Row] = []
    yield from write_measurements(_with_events(measurements(quick=quick)), folder / ROWS, rows)
    write_text(folder / TABLE, table(rows) + "\n")


def _with_events(rows: Iterable[Row]) -> Iterator[Event | Row]:
    stopwatch = Stopwatch()
    for count, row in enumerate(rows, start=1):
        yield row
        yield Event("refinement", stopwatch.seconds, count, note=row.name)


def table(rows: Iterable[Row]) -> str:
    """Markdown: the cases that ended, then the refused ones with their messages."""
    rows = list(rows)
    head = ("", "outcome", "dB before", "dB after", "largest change", "s")
    lines = [
        (f"**{row.name}**: {row.why}", row.outcome, *_cells(row), f"{row.seconds:.1f}")
        for row in rows
        if row.outcome != "refused"
    ]
    refused = [
        f"- {row.name} ({row.why}): {row.message}" for row in rows if row.outcome == "refused"
    ]
    parts = [markdown_table(head, lines)]
    if refused:
        parts += ["Refused:", "\n".join(refused)]
    return "\n\n".join(parts)


def _cells(row: Row) -> tuple[str, str, str]:
    numbers = (row.before, row.after, row.largest)
    before, after, largest = ("" if n is None else f"{n:.3g}" for n in numbers)
    return before, after, largest
