"""The folder of the experiments: runs, summary.json, report.md."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import torch

from gsedit.bench.results import write_text
from gsedit.run.events import Event
from gsedit.run.json_lines import plain
from gsedit.run.stopwatch import Stopwatch
from research.paper.claims import claims_table
from research.paper.measure import run_to_file
from research.paper.runs import Record, Run, read_record
from research.paper.studies import Size, Study, distinct
from research.paper.summary import Records, summarise
from research.paper.tables import tables

RUNS, SUMMARY, REPORT = "runs", "summary.json", "report.md"
CLAIMS = "claims"
TITLE = "Efficient-NeRF2NeRF, repeated on Gaussians"

SECTIONS: Sequence[tuple[str, Sequence[str]]] = (
    ("What was found, claim by claim", (CLAIMS,)),
    ("How right an edit is (figures 7 to 9)", ("strategies",)),
    ("Times sooner than iterative (abstract, section 5)", ("speed-up",)),
    ("The method as printed, with one change each (sections 4.1 to 4.3, figures 5, 11)",
     ("paper-arms",)),
    ("gsedit's default, with one change each", ("default-arms",)),
    ("Where the regularization ends (figure 6)", ("t-end",)),
)  # fmt: skip
"""Titles of the report, and names of the tables below them."""


def run_all(folder: Path, studies: Sequence[Study], *, jobs: int) -> Iterator[Event]:
    """Do every run that is not in the folder yet; an event a run, with its error if it failed.

    `jobs` runs go on at once, each in a process of one thread; with 1 they run here.
    """
    runs, stopwatch = list(distinct(studies).values()), Stopwatch()
    (folder / RUNS).mkdir(parents=True, exist_ok=True)
    for number, (run, error) in enumerate(_done(runs, folder / RUNS, jobs), 1):
        note = f"{run.arm.label}, {run.case.name}, {run.editor}, seed {run.seed}"
        failed = folder / RUNS / f"{run.key}.failed"
        if error:
            write_text(failed, error + "\n")
            note += f": FAILED, {error}"
        else:
            failed.unlink(missing_ok=True)
        yield Event("paper", stopwatch.seconds, number, len(runs), note=note)


def _done(runs: Sequence[Run], folder: Path, jobs: int) -> Iterator[tuple[Run, str]]:
    """Each run with its error, empty for most, as they end."""
    work = partial(_attempt, folder=folder)
    if jobs == 1:
        torch.set_num_threads(1)
        yield from ((run, work(run)) for run in runs)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, torch.set_num_threads, (1,)) as pool:
        waiting = {pool.submit(work, run): run for run in runs}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _attempt(run: Run, folder: Path) -> str:
    """Do a run; returns what went wrong: the others go on."""
    try:
        run_to_file(run, folder)
    except Exception as error:  # an edit may fail in any way
        return f"{type(error).__name__}: {error}".splitlines()[0]
    return ""


def read_records(folder: Path, studies: Sequence[Study]) -> tuple[Records, dict[str, str]]:
    """The runs of these studies that are in the folder, and the errors of those that failed."""
    records: dict[str, Record] = {}
    failed: dict[str, str] = {}
    for key in distinct(studies):
        record, error = (folder / RUNS / f"{key}.{ending}" for ending in ("json", "failed"))
        if record.exists():
            records[key] = read_record(record)
        elif error.exists():
            failed[key] = error.read_text(encoding="utf-8").strip()
    return records, failed


def write_results(folder: Path, size: Size, studies: Sequence[Study]) -> None:
    """SUMMARY and REPORT, of the runs that are in the folder."""
    records, failed = read_records(folder, studies)
    summary = plain(summarise(size, studies, records, failed))
    write_text(folder / SUMMARY, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    found = {CLAIMS: claims_table(summary), **tables(summary)}
    parts = [f"# {TITLE}", found["conditions"]]
    for title, names in SECTIONS:
        parts += [f"## {title}", *(found[name] for name in names)]
    write_text(folder / REPORT, "\n\n".join(parts) + "\n")
