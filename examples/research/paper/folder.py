"""The folder of the experiments: runs, summary.json, plots, pictures, report.md."""

from __future__ import annotations

import json
import multiprocessing
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

import torch
from PIL import Image

from gsedit.bench.results import write_text
from gsedit.errors import InputError
from gsedit.runs.events import Event
from gsedit.runs.json_lines import plain
from gsedit.runs.stopwatch import Stopwatch
from gsedit.storage.atomic import atomic_path
from gsedit.storage.json_files import object_of, read_json
from research.paper import pictures, plots
from research.paper.claims import claims_table
from research.paper.measure import run_to_files
from research.paper.runs import Record, Run, read_record
from research.paper.studies import Size, Study, distinct
from research.paper.summary import Records, summarise
from research.paper.tables import tables, write_tables

RUNS, SUMMARY, REPORT = "runs", "summary.json", "report.md"
CLAIMS = "claims"
TITLE = "Efficient-NeRF2NeRF, repeated on Gaussians"

SECTIONS: Sequence[tuple[str, Sequence[str]]] = (
    ("What was found, claim by claim", (CLAIMS,)),
    ("What the result owes to each part", ("factorial.png", "factorial")),
    ("How soon an edit is right (figures 7 to 9)",
     ("error.png", "similarity.png", "strategies", "repeats")),
    ("Times sooner than iterative (abstract, section 5)", ("speed_up.png", "speed-up")),
    ("Strategies side by side (figures 2, 7, 8)", ("strategies.png",)),
    ("The method as printed, with one change each (sections 4.1 to 4.3, figures 5, 11)",
     ("paper_arms.png", "paper_pictures.png", "paper-arms")),
    ("gsedit's default, with one change each",
     ("default_arms.png", "default_pictures.png", "default-arms")),
    ("Where the regularization ends (figure 6)", ("t_end_pictures.png", "t_end.png", "t-end")),
)  # fmt: skip
"""Titles of the report, and names of plots and tables below them."""


def run_all(
    folder: Path, studies: Sequence[Study], *, jobs: int, clip: Path | None
) -> Iterator[Event]:
    """Do every run that is not in the folder yet; an event a run, with its error if it failed.

    `jobs` runs go on at once, each in a process of one thread; with 1 they run here.
    """
    runs, stopwatch = list(distinct(studies).values()), Stopwatch()
    (folder / RUNS).mkdir(parents=True, exist_ok=True)
    for number, (run, error) in enumerate(_done(runs, folder / RUNS, jobs, clip), 1):
        note = f"{run.arm.label}, {run.case.name}, {run.editor}, seed {run.seed}"
        failed = folder / RUNS / f"{run.key}.failed"
        if error:
            write_text(failed, error + "\n")
            note += f": FAILED, {error}"
        else:
            failed.unlink(missing_ok=True)
        yield Event("paper", stopwatch.seconds, number, len(runs), note=note)


def _done(
    runs: Sequence[Run], folder: Path, jobs: int, clip: Path | None
) -> Iterator[tuple[Run, str]]:
    """Each run with its error, empty for most, as they end."""
    work = partial(_attempt, folder=folder, clip=clip)
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


def _attempt(run: Run, folder: Path, clip: Path | None) -> str:
    """Do a run; returns what went wrong: the others go on."""
    try:
        run_to_files(run, folder, clip)
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


def write_results(folder: Path, size: Size, studies: Sequence[Study], real: float) -> None:
    """SUMMARY, the plots and pictures, and REPORT, of the runs that are in the folder.

    `real`: seconds of an evaluation of a real 2D editor.
    """
    records, failed = read_records(folder, studies)
    summary = plain(summarise(size, studies, records, real, failed))
    write_text(folder / SUMMARY, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    if records:
        _draw(folder, {study.name: study for study in studies}, records, summary, real)
    found = all_tables(summary)
    parts = [f"# {TITLE}", found["conditions"]]
    for title, names in SECTIONS:
        drawn = [f"![{name}]({name})" for name in names if (folder / name).exists()]
        shown = drawn + [found[name] for name in names if name in found]
        parts += [f"## {title}", *shown] if shown else []
    write_text(folder / REPORT, "\n\n".join(parts) + "\n")


def all_tables(summary: Mapping[str, Any]) -> dict[str, str]:
    """By name, from summary.json."""
    return {CLAIMS: claims_table(summary), **tables(summary)}


def write_docs(page: Path, folder: Path) -> None:
    """Replace the tables of the page, between its markers, by those of the folder's summary.json,
    and the pictures ../images/paper_NAME that it shows by the folder's.

    Raises InputError.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{page} cannot be read ({error})") from error
    advice = "run python -m research.paper first"
    summary = read_json(folder / SUMMARY, object_of({}), advice=advice)
    write_text(page, write_tables(text, all_tables(summary)))
    for name, ending in re.findall(r"\(\.\./images/paper_(\w+)\.(png|jpg)\)", text):
        if (drawn := folder / f"{name}.png").exists():
            shown = page.parent.parent / "images" / f"paper_{name}.{ending}"
            with atomic_path(shown, overwrite=True) as temporary, Image.open(drawn) as picture:
                kind = {"jpg": "JPEG", "png": "PNG"}[ending]
                picture.convert("RGB").save(temporary, format=kind, optimize=True)


def _draw(
    folder: Path, studies: Mapping[str, Study], records: Records, summary: Mapping[str, Any],
    real: float,
) -> None:  # fmt: skip
    runs = folder / RUNS
    plots.error_curves(list(studies.values()), records, real, folder / "error.png")
    plots.speed_ups(summary, folder / "speed_up.png")
    plots.t_end_curves(summary, folder / "t_end.png")
    plots.factorial(summary, folder / "factorial.png")
    pictures.grid(pictures.t_end_rows(list(studies.values())), runs, folder / "t_end_pictures.png")
    for name in ("paper", "default"):
        plots.changes(summary, name, folder / f"{name}_arms.png")
        if name in studies:
            shown = pictures.arm_rows(studies[name])
            pictures.grid(shown, runs, folder / f"{name}_pictures.png")
    if "strategies" in studies:
        pictures.grid(pictures.strategy_rows(studies), runs, folder / "strategies.png")
    if "repeats" in studies:
        plots.similarity_curves(studies["repeats"], records, folder / "similarity.png")
