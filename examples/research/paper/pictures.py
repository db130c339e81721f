"""Pictures of the paper's figures, put together from those that runs left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsedit.formats.pictures import save_picture
from research.paper.runs import Run
from research.paper.studies import CLOSED_FORM, SINGLE_PASS, Study

STRIP = ("input a", "input b", "edited a", "edited b", "input held out", "scene", "right")
"""Columns of a run's picture, from left to right: two views, what the editor made of them; a
held-out view unedited, edited, and as it should be."""
CELL, GAP, LABEL, SIDE = 128, 4, 30, 150


@dataclass(frozen=True)
class Cell:
    """A picture of a run, and what is written above it."""

    run: Run
    part: str
    """One of the names in STRIP."""
    label: str = ""


def grid(rows: Sequence[tuple[str, Sequence[Cell]]], runs: Path, path: Path) -> bool:
    """A PNG of labelled rows of pictures; False, and no file, where one is missing."""
    pictures = [[_cut(cell, runs) for cell in cells] for _, cells in rows]
    if not rows or any(p is None for line in pictures for p in line):
        return False
    columns = max(map(len, pictures))
    size = (SIDE + columns * (CELL + GAP), len(rows) * (CELL + LABEL + GAP))
    sheet = Image.new("RGB", size, "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(11)
    for r, ((name, cells), line) in enumerate(zip(rows, pictures)):
        top = r * (CELL + LABEL + GAP)
        draw.multiline_text((4, top + LABEL + 4), _wrapped(name, 22), fill="black", font=font)
        for c, (cell, picture) in enumerate(zip(cells, line)):
            left = SIDE + c * (CELL + GAP)
            draw.multiline_text((left, top + 2), _wrapped(cell.label, 22), fill="black", font=font)
            if picture is not None:
                sheet.paste(picture, (left, top + LABEL))
    save_picture(sheet, path, overwrite=True)
    return True


def _cut(cell: Cell, runs: Path) -> Image.Image | None:
    path = runs / f"{cell.run.key}.png"
    if not path.exists():
        return None
    with Image.open(path) as strip:
        width = strip.width // len(STRIP)
        left = STRIP.index(cell.part) * width
        part = strip.crop((left, 0, left + width, strip.height)).convert("RGB")
    scale = CELL / max(part.size)
    whole = Image.new("RGB", (CELL, CELL), "white")
    size = (max(1, round(part.width * scale)), max(1, round(part.height * scale)))
    whole.paste(part.resize(size, Image.Resampling.NEAREST))
    return whole


def _wrapped(text: str, width: int) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(text, width)[:3])


def regularisation_rows(study: Study) -> list[tuple[str, list[Cell]]]:
    """The paper's figure 5: two views as they are, edited one by one, averaged in all steps, and
    in the first ten."""
    by_label = _first_runs(study)
    base = "x_t-1, independent noise"
    wanted = {
        "(b) view by view": f"{base}: 0",
        "(c) averaged in all 50 steps": f"{base}: 50",
        "(d) averaged in 10 steps, as printed": f"{base}: 10",
        "(d) the same, x0 and shared noise": "x0, shared noise: 10",
    }
    if any(label not in by_label for label in wanted.values()):
        return []
    first = by_label[f"{base}: 0"]
    rows = [("(a) input views", [Cell(first, "input a"), Cell(first, "input b")])]
    for name, label in wanted.items():
        run = by_label[label]
        rows.append((name, [Cell(run, "edited a"), Cell(run, "edited b")]))
    return rows


def t_end_rows(study: Study) -> list[tuple[str, list[Cell]]]:
    """The paper's figure 6: a view, edited with 0 to 50 averaged steps."""
    rows: dict[str, list[Cell]] = {}
    for label, run in _first_runs(study).items():
        base, _, averaged = label.rpartition(": ")
        rows.setdefault(base, []).append(Cell(run, "edited a", f"T_end = {averaged}"))
    return [
        (base, [Cell(cells[0].run, "input a", "input"), *cells]) for base, cells in rows.items()
    ]


def strategy_rows(study: Study) -> list[tuple[str, list[Cell]]]:
    """The paper's figures 7 and 8: a held-out view of every scene, by every strategy."""
    rows: dict[str, list[Cell]] = {}
    for run in study.runs:
        if run.seed == study.runs[0].seed:
            name = f"{run.case.name}, {run.editor}: {run.case.prompt}"
            rows.setdefault(name, []).append(Cell(run, "scene", run.arm.label))
    return [
        (name, [Cell(cells[0].run, "input held out", "input"), *cells,
                Cell(cells[0].run, "right", _right(cells[0].run))])
        for name, cells in rows.items()
        if cells[0].run.arm.strategy == SINGLE_PASS
    ]  # fmt: skip


def _right(run: Run) -> str:
    """Words for the picture that a run's errors refer to."""
    return "the exact edit" if run.editor == CLOSED_FORM else "what the editor makes of it"


def loss_rows(study: Study) -> list[tuple[str, list[Cell]]]:
    """The paper's figure 11: a held-out view under each loss."""
    rows: dict[str, list[Cell]] = {}
    for run in study.runs:
        if run.seed == study.runs[0].seed:
            rows.setdefault(run.case.name, []).append(Cell(run, "scene", run.arm.label))
    return [(name, [*c, Cell(c[0].run, "right", "the exact edit")]) for name, c in rows.items()]


def _first_runs(study: Study) -> dict[str, Run]:
    """Runs of the first scene and seed, by the arm."""
    first = study.runs[0]
    return {
        run.arm.label: run
        for run in study.runs
        if (run.case, run.editor, run.seed) == (first.case, first.editor, first.seed)
    }
