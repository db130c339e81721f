"""Every number of the report, from the records of the runs: summary.json."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from gsedit.measures.decibels import psnr_from_rmse
from research.paper.arms import ITERATIVE
from research.paper.race import AS_GOOD, REAL_EVALUATION, final_error, race, regimes
from research.paper.runs import Record, Run
from research.paper.studies import BRANCHES, Size, Study, distinct

Records = Mapping[str, Record]
"""By the key of the run."""
Row = Mapping[str, Any]
"""A run of a summary: arm, editor, scene, seed, and each of METRICS."""

METRICS: dict[str, Callable[[Record], float | None]] = {
    "final_db": lambda record: psnr_from_rmse(final_error(record)),
    "target_db": lambda record: _decibels(record.target_error),
    "residual_db": lambda record: _decibels(record.residual),
    "disagreement": lambda record: record.disagreement,
    "unedited_disagreement": lambda record: record.unedited_disagreement,
    "target_sharpness": lambda record: record.target_sharpness,
    "sharpness": lambda record: record.sharpness,
    "matched": lambda record: record.matched,
    "cpu": lambda record: record.curve[-1].cpu,
}


def summarise(
    size: Size, studies: Sequence[Study], records: Records, failed: Mapping[str, str]
) -> dict[str, Any]:
    """The numbers of all runs that are done, and what is not.

    `failed`: errors by the key of the run.
    """
    runs = distinct(studies)
    done = [records[key] for key in runs if key in records]
    return {
        "size": asdict(size),
        "missing": {
            study.name: missing
            for study in studies
            if (missing := sum(run.key not in records for run in study.runs))
        },
        "failed": {_named(runs[key]): error for key, error in failed.items() if key in runs},
        "runs": len(done),
        "planned": len(runs),
        "machines": sorted({record.machine for record in done}),
        "threads": sorted({record.threads for record in done}),
        "commits": sorted({record.commit for record in done}),
        "dates": [min((r.date for r in done), default=""), max((r.date for r in done), default="")],
        "cpu_hours": sum(record.cpu for record in done) / 3600,
        "costs": {
            "real_evaluation_seconds": REAL_EVALUATION,
            "as_good_factor": AS_GOOD,
        },
        "rows": [row for study in studies for row in _rows(study, records)],
        "races": list(_races(studies, records)),
    }


def _named(run: Run) -> str:
    return f"{run.arm.label}, {run.case.name}, {run.editor}, seed {run.seed}"


def _rows(study: Study, records: Records) -> Iterator[dict[str, Any]]:
    """A row a run: its arm, editor, scene, seed and metrics."""
    for run in study.runs:
        if record := records.get(run.key):
            yield {
                "study": study.name, "arm": run.arm.label, "editor": run.editor,
                "scene": run.case.name, "seed": run.seed,
                **{name: metric(record) for name, metric in METRICS.items()},
            }  # fmt: skip


def _races(studies: Sequence[Study], records: Records) -> Iterator[dict[str, Any]]:
    """Every arm's race against iterative on its scene, editor and seed."""
    runs = [run for study in studies for run in study.runs if run.key in records]
    of = {(r.arm.label, r.case, r.editor, r.seed): records[r.key] for r in runs}
    for (label, case, editor, seed), record in of.items():
        against = of.get((ITERATIVE, case, editor, seed))
        if against is None or record is against:
            continue
        found = race(record, against)
        half = race(record, against, share=0.5)
        costs = regimes(BRANCHES[editor])
        yield {
            "arm": label, "editor": editor, "scene": case.name, "seed": seed,
            **{name: found.speed_up(each) for name, each in costs.items()},
            **{f"half_{name}": half.speed_up(each) for name, each in costs.items()},
        }  # fmt: skip


def _decibels(error: float | None) -> float | None:
    return None if error is None else psnr_from_rmse(max(error, 1e-5))
