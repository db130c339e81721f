"""Rows of the benchmark of objects, and their tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from gsedit.bench.results import Provenance, markdown_table, provenance

SENTENCES = ("phrase", "refusal")
"""Tasks that are told in sentences instead of a table."""
RIGHT = 0.5
"""IoU with a thing above which a phrase has found it."""
COLUMNS = {
    "unseen_psnr": ("unseen, dB", ".1f"),
    "hole_psnr": ("hole, dB", ".1f"),
    "seam": ("seam", ".2f"),
    "changed_psnr": ("changed, dB", ".1f"),
    "changed_ssim": ("SSIM", ".3f"),
    "changed_perceptual": ("perceptual", ".3f"),
    "outside_psnr": ("outside, dB", ".1f"),
    "contact": ("contact", "+.1%"),
    "iou": ("IoU", ".2f"),
    "iou_1": ("IoU, 1 click", ".2f"),
    "iou_2": ("2 clicks", ".2f"),
    "iou_3": ("3 clicks", ".2f"),
    "refused": ("refused", ".0f"),
}
"""Measure -> (head of its column, format)."""


@dataclass(frozen=True)
class Row:
    """Measurements of one method at one case."""

    case: str
    task: str
    method: str
    measures: dict[str, float | None] = field(default_factory=dict)
    """Values by name; docs/measurements/objects.md defines each."""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_gigabytes: float | None = None
    """Most memory of the process while the method ran; None where the system does not say."""
    note: str = ""
    """Refusal or missing part, for a person."""
    provenance: Provenance = field(default_factory=provenance)


def table(rows: Iterable[Row]) -> str:
    """Markdown tables, one for each task, with the means of each method at the end."""
    rows, parts = list(rows), []
    for task in dict.fromkeys(row.task for row in rows):
        own = [row for row in rows if row.task == task]
        if task not in SENTENCES:
            parts.append(f"{task}\n\n{_task_table(own)}")
    return "\n\n".join((*parts, *_summary(rows)))


def _task_table(rows: Sequence[Row]) -> str:
    names = [name for name in COLUMNS if any(r.measures.get(name) is not None for r in rows)]
    cells = [(row.case, row.method, *_cells(row, names)) for row in rows]
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method and row.measures]
        if len(own) > 1:
            cells.append(("**mean**", method, *_cells(_mean(own), names)))
    heads = [COLUMNS[name][0] for name in names]
    return markdown_table(("case", "method", *heads, "CPU s", "peak GB"), cells)


def _cells(row: Row, names: Sequence[str]) -> list[str]:
    if not row.measures:
        return [*("-" for _ in names), "-", row.note]
    values = [(row.measures.get(name), COLUMNS[name][1]) for name in names]
    shown = ["-" if value is None else format(value, form) for value, form in values]
    peak = "-" if row.peak_gigabytes is None else f"{row.peak_gigabytes:.1f}"
    return [*shown, f"{row.cpu_seconds:.1f}", peak]


def _mean(rows: Sequence[Row]) -> Row:
    """Means of measures, of the size of contacts, and the largest peak of memory."""
    measures: dict[str, float | None] = {}
    for name in COLUMNS:
        values = [row.measures.get(name) for row in rows]
        known = [abs(v) if name == "contact" else v for v in values if v is not None]
        measures[name] = fmean(known) if known else None
    peaks = [row.peak_gigabytes for row in rows if row.peak_gigabytes is not None]
    seconds = fmean(row.cpu_seconds for row in rows)
    return Row("", rows[0].task, rows[0].method, measures, 0.0, seconds, max(peaks, default=None))


def _summary(rows: Sequence[Row]) -> list[str]:
    """Sentences on the phrases, where any were read."""
    asked, unknown = ([row for row in rows if row.task == task] for task in SENTENCES)
    if not asked:
        return []
    wrong = [row for row in asked if (row.measures.get("iou") or 0) <= RIGHT]
    taken = [row for row in unknown if not row.measures.get("refused")]
    text = (
        f"Phrases: {len(asked) - len(wrong)} of {len(asked)} found the right thing (IoU above "
        f"{RIGHT}); {len(unknown) - len(taken)} of {len(unknown)} that name nothing were refused. "
        f"CPU: {fmean(row.cpu_seconds for row in asked):.1f} s a phrase."
    )
    lists = {"Not found": wrong, "Not refused": taken}
    named = (f"{n}: {'; '.join(row.case for row in each)}." for n, each in lists.items() if each)
    return ["\n".join((text, *named))]
