"""The folder of the experiments: runs, summary.json, tables, plots, pictures, report.html."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import torch

from gsedit.bench.results import write_text
from gsedit.errors import InputError
from gsedit.runs.events import Event
from gsedit.runs.json_lines import plain
from gsedit.runs.stopwatch import Stopwatch
from gsedit.storage.json_files import object_of, read_json
from research.paper import pictures, plots
from research.paper.claims import claims_table
from research.paper.measure import run_to_files
from research.paper.report import Section, report
from research.paper.runs import Record, Run
from research.paper.studies import Size, Study
from research.paper.summary import Records, summarise
from research.paper.tables import tables, write_tables

RUNS, SUMMARY, TABLES, REPORT = "runs", "summary.json", "tables.md", "report.html"
CLAIMS = "claims"
TITLE = "Efficient-NeRF2NeRF, repeated on Gaussians"

SECTIONS = (
    Section("What was found", "its claims, in its order", tables=(CLAIMS,), words=True),
    Section(
        "How soon an edit is right", "figure 9, CLIP similarity over training; figures 7 and 8",
        "Error to the exact edit at held-out cameras in place of CLIP similarity: the closed-form "
        "editor has an exact edit. The editor small has none; its curves are to what it makes of "
        "the held-out views itself. Lines are means over scenes and seeds, bands one standard "
        "deviation. No time of measuring is in them.",
        ("error.png",), ("strategies",),
    ),
    Section(
        "Times sooner than iterative", "abstract: 10 times; section 5, times on an A100",
        "Iterative's seconds to its own final error over those of each strategy, on the median "
        "scene, for any cost of the 2D editor: from the measured counts of evaluations and steps.",
        ("speed_up.png",), ("speed-up",),
    ),
    Section("Strategies side by side", "figures 2, 7 and 8", pictures=("strategies.png",)),
    Section("Regularisation of the views", "figure 5", pictures=("regularisation.png",)),
    Section(
        "Where the regularisation ends", "figure 6; section 4.2",
        pictures=("t_end_pictures.png", "t_end.png"), tables=("t-end",),
    ),
    Section("What is averaged, and the noise", "section 4.1, eq. (averageall)",
            pictures=("consensus.png",), tables=("consensus",)),
    Section("Which matches are believed", "section 4.1: noise in the pairs of points",
            pictures=("visibility.png",), tables=("visibility",)),
    Section("Views of a batch", "section 4.3: B, in the paper 4",
            pictures=("views.png",), tables=("views",)),
    Section(
        "The loss of the update", "figure 11; eq. (loss), section 5.2, introduction",
        "Every view is edited on its own (without consensus), so that the pictures contradict each "
        "other.", ("loss.png", "loss_pictures.png"), ("loss",),
    ),
    Section(
        "The combined method", "figure 10; section 5.2",
        "Iterative from scratch, and after the single pass; a line a run.",
        ("combined.png",), ("combined",),
    ),
    Section("Tuning", "not in the paper", "On a scene that is measured nowhere else.",
            tables=("tuning",)),
)  # fmt: skip


def paper_to_folder(
    folder: Path, size: Size, studies: Sequence[Study], *, jobs: int, skipped: str = ""
) -> Iterator[Event]:
    """Every run that is not in the folder yet, then what they say; an event a run.

    `jobs` runs go on at once, each in a process of one thread; with 1 they run here, with torch's
    threads. `skipped` says what could not be run.
    """
    runs = list({run.key: run for study in studies for run in study.runs}.values())
    stopwatch = Stopwatch()
    records: dict[str, Record] = {}
    for run, record in _done(runs, folder / RUNS, jobs):
        records[run.key] = record
        note = f"{run.arm.label}, {run.case.name}, {run.editor}, seed {run.seed}"
        yield Event("paper", stopwatch.seconds, len(records), len(runs), note=note)
    write_results(folder, size, studies, records, skipped)


def _done(runs: Sequence[Run], folder: Path, jobs: int) -> Iterator[tuple[Run, Record]]:
    """Each run with its record, as they end."""
    folder.mkdir(parents=True, exist_ok=True)
    if jobs == 1:
        for run in runs:
            yield run, run_to_files(run, folder)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, torch.set_num_threads, (1,)) as pool:
        waiting = {pool.submit(run_to_files, run, folder): run for run in runs}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def write_results(
    folder: Path, size: Size, studies: Sequence[Study], records: Records, skipped: str
) -> None:
    """SUMMARY, TABLES, the plots and pictures, and REPORT."""
    summary = plain(summarise(size, studies, records, skipped))
    write_text(folder / SUMMARY, json.dumps(summary, indent=1, allow_nan=False) + "\n")
    found = all_tables(summary)
    text = "\n\n".join(f"## {name}\n\n{table}" for name, table in found.items())
    write_text(folder / TABLES, text + "\n")
    _draw(folder, studies, records, summary)
    write_text(folder / REPORT, report(TITLE, found["conditions"], SECTIONS, found, folder))


def all_tables(summary: dict[str, Any]) -> dict[str, str]:
    """By name, from summary.json."""
    return {CLAIMS: claims_table(summary), **tables(summary)}


def read_summary(folder: Path) -> dict[str, Any]:
    """Read summary.json of a folder. Raises InputError."""
    path = folder / SUMMARY
    return read_json(path, object_of({}), advice="run python -m research.paper first")


def write_docs(page: Path, folder: Path) -> None:
    """Replace the tables of the page, between its markers, by those of the folder's summary.json.

    Raises InputError.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{page} cannot be read ({error})") from error
    write_text(page, write_tables(text, all_tables(read_summary(folder))))


def _draw(
    folder: Path, studies: Sequence[Study], records: Records, summary: dict[str, Any]
) -> None:
    by_name = {study.name: study for study in studies}
    runs = folder / RUNS
    if "strategies" in by_name:
        compared = by_name["strategies"]
        plots.error_curves(compared, records, folder / "error.png")
        plots.speed_ups(summary["editors"], folder / "speed_up.png")
        plots.combined_curves(compared, records, folder / "combined.png")
        pictures.grid(pictures.strategy_rows(compared), runs, folder / "strategies.png")
    if "t-end" in by_name:
        plots.t_end_curves(by_name["t-end"], records, folder / "t_end.png")
        rows = pictures.regularisation_rows(by_name["t-end"])
        pictures.grid(rows, runs, folder / "regularisation.png")
        rows = pictures.t_end_rows(by_name["t-end"])
        pictures.grid(rows, runs, folder / "t_end_pictures.png")
    every = plots.PICTURES
    for name, measures in {
        "consensus": every,
        "visibility": every,
        "views": ("disagreement", "target", "final"),
        "loss": ("scene sharpness", "final"),
    }.items():
        if name in by_name:
            plots.dots(by_name[name], records, measures, folder / f"{name}.png")
    if "loss" in by_name:
        pictures.grid(pictures.loss_rows(by_name["loss"]), runs, folder / "loss_pictures.png")
