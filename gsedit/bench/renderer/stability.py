"""Edge cases, drawn: which are finite, which are refused, and their errors beside the textbook's.

Drawn without the early stop, so that errors are rounding and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Literal

import torch
from torch import Tensor

from gsedit.bench.renderer.accuracy import Draw, Drawn, differentiate, errors, with_pose
from gsedit.bench.renderer.edge_cases import EDGE_CASES, EdgeCase, RenderInput
from gsedit.bench.results import markdown_table, write_text
from gsedit.run.events import Event
from gsedit.run.json_lines import Journal
from gsedit.run.stopwatch import Stopwatch
from rasterizer.numerics import AUTO, Execution, Numerics
from rasterizer.reference import render_reference
from rasterizer.render import render

Outcome = Literal["finite", "refused", "not finite"]
ROWS_FILE, TABLE_FILE = "stability.jsonl", "stability.md"
WITHOUT_STOP = Numerics(transmittance_min=0.0)


@dataclass(frozen=True)
class EdgeCaseMeasurement:
    """One edge case in one dtype. None: not measured, or not finite."""

    name: str
    why: str
    dtype: str
    gaussians: int
    width: int
    height: int
    outcome: Outcome
    """Outcome of the picture and of all its gradients."""
    message: str
    """The ValueError's text where it was refused."""
    image_error: float | None
    """Largest error of a color, against the float64 reference of the same rounded inputs; in
    units of the brightest color where that is above 1."""
    gradient_error: float | None
    """Relative L2 error of the worst input, the pose among them."""
    textbook: Outcome | None
    """Outcome of the plain conic formula in the same dtype; None in float64, the reference."""
    textbook_image_error: float | None
    textbook_gradient_error: float | None
    seconds: float | None
    """Median seconds of the rasterizer, forward and backward."""


def stability_to_folder(folder: Path, *, quick: bool) -> Iterator[Event | EdgeCaseMeasurement]:
    """All edge cases, written to a folder: ROWS_FILE meanwhile, so that an interruption loses none,
    then TABLE_FILE."""
    journal: Journal[EdgeCaseMeasurement] = Journal(folder / ROWS_FILE)
    stopwatch = Stopwatch()
    for row in measurements(quick=quick):
        journal.write(row)
        yield row
        yield Event("stability", stopwatch.seconds, len(journal.records), note=row.name)
    write_text(folder / TABLE_FILE, table(journal.records) + "\n")


def measurements(quick: bool = False) -> Iterator[EdgeCaseMeasurement]:
    """Every edge case in float32, then in float64; only float32 if `quick`."""
    for case in EDGE_CASES:
        for dtype in (torch.float32,) if quick else (torch.float32, torch.float64):
            yield measure_edge_case(case, dtype)


def measure_edge_case(
    case: EdgeCase, dtype: torch.dtype, runs: int = 3, execution: Execution = AUTO
) -> EdgeCaseMeasurement:
    """Draw one edge case with the rasterizer (`runs` times) and by the textbook's formula, both
    with gradients."""
    given = case.make(dtype)
    draw = _rasterizer(given, execution)
    drawn, message, seconds = _timed(draw, given, runs)
    image = gradient = textbook = textbook_image = textbook_gradient = None
    if drawn is not None:
        drawn = with_pose(drawn, draw, given.scene, given.camera)
        exact = RenderInput(given.scene.to(torch.float64), given.camera, given.background.double())
        reference = differentiate(_textbook(exact), exact.scene, exact.camera, pose=True)
        image, gradient = _errors(drawn, reference)
        if dtype != torch.float64:
            plain = differentiate(_textbook(given), given.scene, given.camera, pose=True)
            textbook = _outcome(plain)
            textbook_image, textbook_gradient = _errors(plain, reference)
    return EdgeCaseMeasurement(
        name=case.name,
        why=case.why,
        dtype=str(dtype).removeprefix("torch."),
        gaussians=len(given.scene),
        width=given.camera.width,
        height=given.camera.height,
        outcome="refused" if drawn is None else _outcome(drawn),
        message=message,
        image_error=image,
        gradient_error=gradient,
        textbook=textbook,
        textbook_image_error=textbook_image,
        textbook_gradient_error=textbook_gradient,
        seconds=seconds,
    )


def _rasterizer(given: RenderInput, execution: Execution) -> Draw:
    options = {"background": given.background, "numerics": WITHOUT_STOP, "execution": execution}
    return lambda scene, camera: render(scene, camera, **options).color


def _textbook(given: RenderInput) -> Draw:
    """The conic formula in the dtype of the scene."""
    dtype = given.scene.means.dtype
    return lambda scene, camera: (
        render_reference(scene, camera, background=given.background, dtype=dtype).color
    )


def _timed(draw: Draw, given: RenderInput, runs: int) -> tuple[Drawn | None, str, float | None]:
    """Picture and gradients, "", and median seconds; or None, the refusal's text, and None."""
    drawn, seconds = None, []
    for _ in range(runs):
        stopwatch = Stopwatch()
        try:
            drawn = differentiate(draw, given.scene, given.camera)
        except ValueError as error:
            return None, str(error), None
        seconds.append(stopwatch.seconds)
    return drawn, "", median(seconds)


def _outcome(drawn: Drawn) -> Outcome:
    parts: list[Tensor] = [drawn.picture, *drawn.gradients.values()]
    return "finite" if all(part.isfinite().all() for part in parts) else "not finite"


def _errors(drawn: Drawn, reference: Drawn) -> tuple[float | None, float | None]:
    """Largest error of a color, worst relative error of a gradient; None where not finite."""
    wrong = errors(drawn, reference)
    brightest = max(1.0, float(reference.picture.abs().max()))
    # max() ignores NaN or returns it, depending on the order of its arguments
    worst = wrong.gradient if _outcome(drawn) == "finite" else None
    return _finite(wrong.largest / brightest), _finite(worst)


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def table(rows: Iterable[EdgeCaseMeasurement]) -> str:
    """Markdown: the cases that are drawn, with errors and time; then the refused, with messages."""
    lines, refused = [], []
    for name, group in groupby(rows, key=lambda row: row.name):
        by_dtype = {row.dtype: row for row in group}
        first = next(iter(by_dtype.values()))
        if first.outcome == "refused":
            refused.append(f"- {name} ({first.why}): {first.message}")
        else:
            lines.append([f"**{name}**: {first.why}", *_cells(by_dtype)])
    parts = [_LEGEND, markdown_table(HEAD, lines)]
    if refused:
        parts += ["Refused, each by a ValueError:", "\n".join(refused)]
    return "\n\n".join(parts)


HEAD = (
    "", "float32 image", "textbook's", "float32 gradients", "textbook's", "float64 image",
    "float64 gradients", "ms",
)  # fmt: skip

_LEGEND = (
    "Errors against the float64 reference of the same inputs: the largest of a color (in units of "
    "the brightest where that is above 1), and the relative L2 error of the worst gradient, pose "
    "included. Textbook: the plain conic formula in float32. ms: forward and backward in float32."
)


def _cells(by_dtype: dict[str, EdgeCaseMeasurement]) -> list[str]:
    def cell(
        dtype: str, outcome: Callable[[EdgeCaseMeasurement], Outcome | None], name: str
    ) -> str:
        row = by_dtype.get(dtype)
        value = None if row is None else getattr(row, name)
        if value is not None:
            return f"{value:.1e}"
        return "" if row is None or outcome(row) is None else f"**{outcome(row)}**"

    single = by_dtype.get("float32")
    seconds = None if single is None else single.seconds
    return [
        cell("float32", lambda row: row.outcome, "image_error"),
        cell("float32", lambda row: row.textbook, "textbook_image_error"),
        cell("float32", lambda row: row.outcome, "gradient_error"),
        cell("float32", lambda row: row.textbook, "textbook_gradient_error"),
        cell("float64", lambda row: row.outcome, "image_error"),
        cell("float64", lambda row: row.outcome, "gradient_error"),
        "" if seconds is None else f"{1e3 * seconds:.1f}",
    ]
