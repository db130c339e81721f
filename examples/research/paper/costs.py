"""Cost of an evaluation of real 2D editors, from what was measured here."""

from __future__ import annotations

import json
import re
import statistics
from dataclasses import dataclass
from pathlib import Path

from gsedit.bench.edit import Point
from gsedit.errors import InputError

PAGE = Path(__file__).parents[3] / "docs" / "measurements" / "editors.md"
ROW = "OpenVINO, bfloat16"
"""Row of the page's table of InstructPix2Pix: the fastest that does all of its arithmetic."""
PAPER_STEP, PAPER_EVALUATION = 0.15, 30 / (4 * 3 * 50)
"""Seconds on the paper's A100: a step of fitting, and an evaluation, from its 30 s a batch of four
views in 50 steps under three conditions."""

CONDITIONS = 3
"""Evaluations of InstructPix2Pix a denoising step: with words and picture, with one, with none."""


@dataclass(frozen=True)
class Costs:
    """Seconds of an evaluation of the network and of a fitting step."""

    name: str
    evaluation: float | None = None
    """Seconds an evaluation; None: as measured."""
    step: float | None = None
    """None: as measured, with everything else that is not the editor."""

    def seconds(self, point: Point) -> float:
        """Processor seconds at these costs, since the first action."""
        editing = (
            point.editing_cpu if self.evaluation is None else self.evaluation * point.evaluations
        )
        rest = point.cpu - point.editing_cpu if self.step is None else self.step * point.steps
        return editing + rest


def regimes(real: float, branches: int = CONDITIONS) -> dict[str, Costs]:
    """As measured; with a real editor of so many seconds an evaluation; and the paper's.

    `branches`: evaluations a step of the editor that ran in the real one's place, which has three.
    """
    times = CONDITIONS / branches
    return {
        "measured": Costs("this editor, as measured"),
        "real": Costs("InstructPix2Pix here", times * real),
        "paper": Costs("the paper's costs on an A100", times * PAPER_EVALUATION, PAPER_STEP),
    }


def real_seconds(results: Path | None = None) -> float:
    """Processor seconds of an evaluation of InstructPix2Pix for a view of 256 pixels.

    From a results file of research.study_editor_cost, its fullest case, or from the row of
    docs/measurements/editors.md. Raises InputError where there is none.
    """
    if results is None:
        found = re.search(
            rf"^\| {ROW} \| ([\d.]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE
        )
        if not found:
            raise InputError(f"{PAGE} has no row '{ROW}': name a results file with --editor-cost")
        return float(found[1])
    try:
        rows = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
        most = max(row["evaluations"] for row in rows if row["model"] != "small")
        return statistics.median(
            row["seconds"] / most
            for row in rows
            if row["model"] != "small" and row["evaluations"] == most
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{results} is no results file of research.study_editor_cost ({error})"
        ) from error
