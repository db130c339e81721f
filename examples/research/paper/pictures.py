"""Pictures of the paper's figures, put together from those that runs left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsedit.formats.pictures import save_picture
from research.paper.arms import DEFAULT, PAPER, T_END_STEPS, t_end_label
from research.paper.runs import Run
from research.paper.studies import Study

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
    """A PNG of labelled rows of pictures; False, and no file, where there is none."""
    cut = [[_cut(cell, runs) for cell in cells] for _, cells in rows]
    rows = [row for row, line in zip(rows, cut) if any(line)]
    pictures = [line for line in cut if any(line)]
    if not rows:
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


def arm_rows(study: Study) -> list[tuple[str, list[Cell]]]:
    """A held-out view of every scene, edited by every arm of the study, with one seed."""
    rows: dict[str, list[Cell]] = {}
    seeds: dict[str, int] = {}
    for run in study.runs:
        name = f"{run.case.name}, {run.editor}: {run.case.prompt}"
        if seeds.setdefault(name, run.seed) == run.seed:
            label = run.arm.label.rpartition(": ")[2]
            rows.setdefault(name, []).append(Cell(run, "scene", label))
    return [
        (name, [Cell(cells[0].run, "input held out", "input"), *cells,
                Cell(cells[0].run, "right", "the reference")])
        for name, cells in rows.items()
    ]  # fmt: skip


def strategy_rows(studies: Mapping[str, Study]) -> list[tuple[str, list[Cell]]]:
    """A held-out view of every scene after the method as printed, gsedit's, and the baselines."""
    baselines = studies["strategies"].runs
    places = {(run.case, run.editor, run.seed) for run in baselines}
    presets = {
        run.key: run for study in studies.values() for run in study.runs
        if run.arm.label in (PAPER, DEFAULT) and (run.case, run.editor, run.seed) in places
    }  # fmt: skip
    return arm_rows(Study("strategies", (*presets.values(), *baselines)))


def t_end_rows(studies: Sequence[Study]) -> list[tuple[str, list[Cell]]]:
    """The paper's figure 6: a view, edited with 0 to 50 averaged steps."""
    wanted = [t_end_label(steps) for steps in T_END_STEPS]
    rows: dict[str, dict[str, Run]] = {}
    for run in (run for study in studies for run in study.runs):
        if run.arm.label in wanted:
            rows.setdefault(f"{run.case.name}, {run.editor}", {}).setdefault(run.arm.label, run)
    return [
        (name, [Cell(runs[wanted[0]], "input a", "input"),
                *(Cell(runs[w], "edited a", f"T_end = {n}") for w, n in zip(wanted, T_END_STEPS))])
        for name, runs in rows.items()
        if len(runs) == len(wanted)
    ]  # fmt: skip
