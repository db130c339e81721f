"""Every number of the report, from the records of the runs: summary.json."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from gsedit.measures.decibels import psnr_from_rmse
from research.paper.runs import Record, Run
from research.paper.statistics import (
    AS_GOOD,
    COSTLY_SECONDS,
    PAPER_EVALUATION,
    PAPER_STEP,
    REGIMES,
    Costs,
    Race,
    final_error,
    median_scene,
    race,
    spread,
)
from research.paper.studies import COMBINED, ITERATIVE, SINGLE_PASS, Size, Study

Records = Mapping[str, Record]
"""By the key of the run."""

RATIOS = tuple(10 ** (k / 4) for k in range(-12, 17))
"""Costs of an evaluation in fitting steps, from a thousandth to ten thousand."""
METRICS: dict[str, Callable[[Record], float | None]] = {
    "final_db": lambda record: psnr_from_rmse(final_error(record)),
    "target_db": lambda record: _decibels(record.target_error),
    "disagreement": lambda record: record.disagreement,
    "unedited_disagreement": lambda record: record.unedited_disagreement,
    "target_sharpness": lambda record: record.target_sharpness,
    "sharpness": lambda record: record.sharpness,
    "matched": lambda record: record.matched,
    "calls": lambda record: record.curve[-1].calls,
    "evaluations": lambda record: record.curve[-1].evaluations,
    "steps": lambda record: record.curve[-1].steps,
    "seconds": lambda record: record.curve[-1].seconds,
    "editing_seconds": lambda record: record.curve[-1].editing,
    "start_db": lambda record: psnr_from_rmse(record.errors[0]),
}


def summarise(size: Size, studies: Sequence[Study], records: Records, skipped: str) -> dict:
    """The numbers of all studies; those of runs that are missing are left out."""
    done = [record for study in studies for run in study.runs if (record := records.get(run.key))]
    return {
        "size": asdict(size),
        "skipped": skipped,
        "runs": len({run.key for study in studies for run in study.runs if run.key in records}),
        "machines": sorted({record.machine for record in done}),
        "threads": sorted({record.threads for record in done}),
        "commits": sorted({record.commit for record in done}),
        "dates": [min((r.date for r in done), default=""), max((r.date for r in done), default="")],
        "costs": {
            "costly_evaluation_seconds": COSTLY_SECONDS,
            "paper_step_seconds": PAPER_STEP,
            "paper_evaluation_seconds": PAPER_EVALUATION,
            "as_good_factor": AS_GOOD,
        },
        "studies": {study.name: _study(study, records) for study in studies},
        "editors": _editors(_of(studies, "strategies"), records),
    }


def _of(studies: Sequence[Study], name: str) -> tuple[Run, ...]:
    return tuple(run for study in studies if study.name == name for run in study.runs)


def _study(study: Study, records: Records) -> dict[str, Any]:
    """Summarize each editor and arm, and each of its scenes: mean and spread of every metric."""
    return {
        "title": study.title,
        "place": study.place,
        "seeds": sorted({run.seed for run in study.runs}),
        "scenes": sorted({run.case.name for run in study.runs}),
        "editors": {
            editor: {label: _metrics(runs, records) for label, runs in arms.items()}
            for editor, arms in _by_editor(study.runs, lambda run: run.arm.label).items()
        },
        "by_scene": {
            editor: {
                scene: {
                    label: _metrics(group, records)
                    for label, group in _grouped(runs, lambda run: run.arm.label).items()
                }
                for scene, runs in scenes.items()
            }
            for editor, scenes in _by_editor(study.runs, lambda run: run.case.name).items()
        },
    }


def _metrics(runs: Iterable[Run], records: Records) -> dict[str, Any]:
    found = [records[run.key] for run in runs if run.key in records]
    return {name: asdict(spread(map(metric, found))) for name, metric in METRICS.items()}


def _by_editor(runs: Iterable[Run], name: Callable[[Run], str]) -> dict[str, dict[str, list[Run]]]:
    editors = _grouped(runs, lambda run: run.editor)
    return {editor: _grouped(group, name) for editor, group in editors.items()}


def _grouped(runs: Iterable[Run], name: Callable[[Run], str]) -> dict[str, list[Run]]:
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(name(run), []).append(run)
    return groups


def _editors(runs: tuple[Run, ...], records: Records) -> dict[str, Any]:
    """Summarize each editor: speed-ups against iterative, costs, the combined experiment."""
    found = {}
    for editor, group in _grouped(runs, lambda run: run.editor).items():
        done = [run for run in group if run.key in records]
        if not done:
            continue
        kinds = {records[run.key].truth for run in done}
        races = _races(done, records)
        found[editor] = {
            "error_to": ", ".join(sorted(kinds)),
            "fitting_step_seconds": asdict(spread(_step_seconds(records[run.key]) for run in done)),
            "evaluation_seconds": asdict(spread(_evaluation_seconds(records[r.key]) for r in done)),
            "speed_up": {
                regime: {label: _speed_up(by_scene, costs) for label, by_scene in races.items()}
                for regime, costs in REGIMES.items()
            },
            "speed_up_by_ratio": {
                "ratios": RATIOS,
                "arms": {
                    label: [median_scene(by_scene, Costs("", r, 1.0)) for r in RATIOS]
                    for label, by_scene in races.items()
                },
            },
            "combined": _combined(done, records),
        }
    return found


def _races(runs: Sequence[Run], records: Records) -> dict[str, dict[str, list[Race]]]:
    """By arm and scene: every seed's race against iterative."""
    baseline = {(run.case, run.seed): run for run in runs if run.arm.label == ITERATIVE}
    races: dict[str, dict[str, list[Race]]] = {}
    for run in runs:
        against = baseline.get((run.case, run.seed))
        if against is None or run.key == against.key:
            continue
        scenes = races.setdefault(run.arm.label, {})
        scenes.setdefault(run.case.name, []).append(race(records[run.key], records[against.key]))
    return races


def _speed_up(by_scene: Mapping[str, Sequence[Race]], costs: Costs) -> dict[str, Any]:
    """Iterative's seconds to its final error over the arm's; 0 where the arm does not reach it."""
    return {
        "median_scene": median_scene(by_scene, costs),
        "scenes": {
            scene: {
                **asdict(spread(r.speed_up(costs) for r in races)),
                "median": median_scene({scene: races}, costs),
                "reached": sum(r.own is not None for r in races),
                "seconds": asdict(spread(r.own and costs.seconds(r.own) for r in races)),
                "iterative_seconds": asdict(spread(costs.seconds(r.iterative) for r in races)),
            }
            for scene, races in by_scene.items()
        },
    }


def _step_seconds(record: Record) -> float | None:
    last = record.curve[-1]
    return (last.seconds - last.editing) / last.steps if last.steps else None


def _evaluation_seconds(record: Record) -> float | None:
    last = record.curve[-1]
    return last.editing / last.evaluations if last.evaluations and last.editing else None


def _combined(runs: Sequence[Run], records: Records) -> dict[str, Any]:
    """Further steps that iterative needs after the single pass to reach what it reaches from
    scratch, and the errors of both."""
    rows = _grouped(runs, lambda run: run.arm.label)
    baseline = {(run.case, run.seed): run for run in rows.get(ITERATIVE, [])}
    first = {(run.case, run.seed): run for run in rows.get(SINGLE_PASS, [])}
    further, scratch, gains, reached_in = [], [], [], []
    for run in rows.get(COMBINED, []):
        place = (run.case, run.seed)
        if place not in baseline or place not in first:
            continue
        record, against = records[run.key], records[baseline[place].key]
        begun = records[first[place].key].curve[-1].steps
        raced = race(record, against)
        scratch.append(raced.iterative.steps)
        reached_in.append(raced.own is not None)
        if raced.own is not None:
            further.append(max(0, raced.own.steps - begun))
        gains.append(psnr_from_rmse(final_error(record)) - psnr_from_rmse(final_error(against)))
    return {
        "further_steps": asdict(spread(further)),
        "steps_from_scratch": asdict(spread(scratch)),
        "reached": sum(reached_in),
        "pairs": len(reached_in),
        "final_gain_db": asdict(spread(gains)),
    }


def _decibels(error: float | None) -> float | None:
    return None if error is None else psnr_from_rmse(max(error, 1e-5))
