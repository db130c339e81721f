"""The museum, drawn: what is finite, what is refused, and how wrong it is beside the textbook.

The whole sum is drawn, without the early stop, so that an error is rounding and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from math import isfinite
from statistics import median
from time import perf_counter
from typing import Literal

import torch
from torch import Tensor

from gsedit.bench.renderer.accuracy import Draw, Drawn, differentiate, errors
from gsedit.bench.renderer.edge_cases import EDGE_CASES, EdgeCase, Shown
from gsedit.bench.renderer.rows import markdown
from rasterizer.numerics import Numerics
from rasterizer.reference import render_reference
from rasterizer.render import render

Outcome = Literal["finite", "refused", "not finite"]
WHOLE_SUM = Numerics(transmittance_min=0.0)


@dataclass(frozen=True)
class Row:
    """One exhibit in one dtype. None: not measured, or not finite."""

    name: str
    why: str
    dtype: str
    gaussians: int
    width: int
    height: int
    outcome: Outcome
    """Of the picture and of all its gradients."""
    message: str
    """The ValueError's text where it was refused."""
    image_error: float | None
    """Largest error of a colour, against the float64 reference of the same rounded inputs; in
    units of the brightest colour where that is above 1."""
    gradient_error: float | None
    """Relative L2 error of the worst input, the pose among them."""
    textbook: Outcome | None
    """Of the plain conic formula in the same dtype; none in float64, where it is the reference."""
    textbook_image_error: float | None
    textbook_gradient_error: float | None
    seconds: float | None
    """Ours, forward and backward, median of the runs."""


def rows(quick: bool = False) -> Iterator[Row]:
    """Every exhibit in float32, then in float64; only float32 if `quick`."""
    for exhibit in EDGE_CASES:
        for dtype in (torch.float32,) if quick else (torch.float32, torch.float64):
            yield measure(exhibit, dtype)


def measure(exhibit: EdgeCase, dtype: torch.dtype, runs: int = 3) -> Row:
    """Draw one exhibit, ours (`runs` times) and the textbook's, with gradients."""
    shown = exhibit.make(dtype)
    found, message, seconds = _timed(_ours(shown), shown, runs)
    image = gradient = textbook = textbook_image = textbook_gradient = None
    if found is not None:
        exact = Shown(shown.scene.to(torch.float64), shown.camera, shown.background.double())
        truth = differentiate(_textbook(exact), exact.scene, exact.camera)
        image, gradient = _errors(found, truth)
        if dtype != torch.float64:
            plain = differentiate(_textbook(shown), shown.scene, shown.camera)
            textbook, (textbook_image, textbook_gradient) = _outcome(plain), _errors(plain, truth)
    return Row(
        name=exhibit.name,
        why=exhibit.why,
        dtype=str(dtype).removeprefix("torch."),
        gaussians=len(shown.scene),
        width=shown.camera.width,
        height=shown.camera.height,
        outcome="refused" if found is None else _outcome(found),
        message=message,
        image_error=image,
        gradient_error=gradient,
        textbook=textbook,
        textbook_image_error=textbook_image,
        textbook_gradient_error=textbook_gradient,
        seconds=seconds,
    )


def _ours(shown: Shown) -> Draw:
    return lambda scene, camera: (
        render(scene, camera, background=shown.background, numerics=WHOLE_SUM).color
    )


def _textbook(shown: Shown) -> Draw:
    """In the dtype of the scene."""
    dtype = shown.scene.means.dtype
    return lambda scene, camera: (
        render_reference(scene, camera, background=shown.background, dtype=dtype).color
    )


def _timed(draw: Draw, shown: Shown, runs: int) -> tuple[Drawn | None, str, float | None]:
    """Picture and gradients, or the text of the refusal; and the seconds it took."""
    found, seconds = None, []
    for _ in range(runs):
        start = perf_counter()
        try:
            found = differentiate(draw, shown.scene, shown.camera)
        except ValueError as error:
            return None, str(error), None
        seconds.append(perf_counter() - start)
    return found, "", median(seconds)


def _outcome(drawn: Drawn) -> Outcome:
    parts: list[Tensor] = [drawn.picture, *drawn.gradients.values()]
    return "finite" if all(part.isfinite().all() for part in parts) else "not finite"


def _errors(found: Drawn, truth: Drawn) -> tuple[float | None, float | None]:
    """Largest error of a colour, worst relative error of a gradient; None where not finite."""
    known = errors(found, truth)
    brightest = max(1.0, float(truth.picture.abs().max()))
    # a maximum passes over NaN, or not, by the order of what it compares
    worst = known.gradient if _outcome(found) == "finite" else None
    return _finite(known.largest / brightest), _finite(worst)


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def table(rows: Iterable[Row]) -> str:
    """Markdown: what is drawn, with errors and time; then what is refused, with the words."""
    lines, refused = [], []
    for name, group in groupby(rows, key=lambda row: row.name):
        by_dtype = {row.dtype: row for row in group}
        first = next(iter(by_dtype.values()))
        if first.outcome == "refused":
            refused.append(f"- {name} ({first.why}): {first.message}")
        else:
            lines.append([f"**{name}**: {first.why}", *_cells(by_dtype)])
    parts = [_LEGEND, markdown(HEAD, lines)]
    if refused:
        parts += ["Refused, each by a ValueError:", "\n".join(refused)]
    return "\n\n".join(parts)


HEAD = (
    "", "float32 image", "textbook's", "float32 gradients", "textbook's", "float64 image",
    "float64 gradients", "ms",
)  # fmt: skip

_LEGEND = (
    "Errors against the float64 reference of the same inputs: the largest of a colour (in units of "
    "the brightest where that is above 1), and the relative L2 error of the worst gradient, pose "
    "included. Textbook: the plain conic formula in float32. ms: forward and backward in float32."
)


def _cells(by_dtype: dict[str, Row]) -> list[str]:
    def cell(dtype: str, outcome: Callable[[Row], Outcome | None], name: str) -> str:
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
