"""The benchmark of operations on objects: write the cases, run the methods, measure the results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import torch
from jaxtyping import Bool
from torch import Tensor

from bench.objects.cases import CASES, CLICKED, Case, on_black
from bench.objects.choosing import (
    Selecting,
    clicking,
    iou,
    nearest_color,
    select_at,
    select_phrase,
)
from bench.objects.files import (
    Given,
    Size,
    check_size,
    place_of,
    read_case,
    read_labelled,
    write_case,
    write_scene,
)
from bench.objects.methods import METHODS, OURS, Made, drawn
from bench.objects.phrases import NAMED, REFUSED
from bench.objects.rows import Row, table
from bench.objects.scores import scores
from bench.staged import Labelled, Stage
from gsedit.bench.results import write_measurements, write_text
from gsedit.diffusion.memory import most_bytes
from gsedit.errors import GseditError, UsageError
from gsedit.formats.flags import read_flags
from gsedit.formats.pictures import read_picture
from gsedit.formats.scenes import load
from gsedit.runs.events import Event
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

ROWS, TABLE = "objects.jsonl", "objects.md"
RESULT = "result"
"""Name of somebody else's method."""
CLICKING: dict[str, Selecting] = {OURS: select_at, "nearest color": nearest_color}
FOOT = 0.02
"""Quantile of the heights of a thing's Gaussians that is its foot."""
Value = TypeVar("Value")


@dataclass(frozen=True)
class Plan:
    """Cases that are measured, and their size."""

    size: Size = field(default_factory=Size)
    cases: tuple[Case, ...] = CASES
    clicked: tuple[str, ...] = CLICKED
    phrased: tuple[str, ...] = tuple(NAMED)


QUICK = Plan(
    Size(gaussians=6000, side=48),
    tuple(case for case in CASES if case.stage == "meadow" or case.task == "relight")[:6],
    ("meadow",),
    ("meadow",),
)


def objects_to_folder(
    folder: Path, plan: Plan | None = None, result: Path | None = None
) -> Iterator[Event | Row]:
    """Run the benchmark; cases, rows and the table are written to a folder.

    `result`: a folder of somebody else's results (docs/howto/measure.md), which are measured
    instead of gsedit's.
    """
    plan = plan or Plan()
    check_size(folder, plan.size)
    rows: list[Row] = []
    yield from write_measurements(_rows(folder, plan, result), folder / ROWS, rows)
    write_text(folder / TABLE, table(rows) + "\n")


def _rows(folder: Path, plan: Plan, result: Path | None) -> Iterator[Event | Row]:
    began = time.monotonic()
    works: list[tuple[str, Callable[[], Iterator[Row]]]] = [
        *((each.name, partial(_of_case, folder, each, plan.size, result)) for each in plan.cases),
        *((f"clicks {n}", partial(_clicks, folder, n, plan.size, result)) for n in plan.clicked),
    ]
    if result is None:
        phrased = (partial(_phrases, folder, name, plan.size) for name in plan.phrased)
        works += [(f"phrases {name}", work) for name, work in zip(plan.phrased, phrased)]
    found = False
    for i, (name, work) in enumerate(works):
        yield Event("objects", time.monotonic() - began, i, len(works), note=name)
        for row in work():
            found = True
            yield row
    if not found:
        raise UsageError(
            f"{result}: no result of any case: name them CASE.ply, CASE/000.png or "
            f"select-STAGE-THING.npy, as in {folder / 'cases'}"
        )


def _of_case(folder: Path, case: Case, size: Size, result: Path | None) -> Iterator[Row]:
    write_case(case, folder, size)
    given = read_case(case, folder)
    measure = partial(_measured, given)
    if result is not None:
        made = _read_result(result, given)
        if made is not None:
            yield Row(case.name, case.task, RESULT, measure(made))
        return
    for name, method in METHODS[case.task].items():
        yield _timed(Row(case.name, case.task, name), partial(method, given), measure)


def _timed(
    row: Row, work: Callable[[], Value], measure: Callable[[Value], dict[str, float | None]]
) -> Row:
    """The row with the measures of what a method makes; a refusal is a note."""
    _forget_peak()
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        made = work()
    except GseditError as error:
        return replace(row, note=str(error))
    seconds, spent = time.perf_counter() - wall, time.process_time() - cpu
    peak = most_bytes() / 1e9 or None
    return replace(
        row, measures=measure(made), seconds=seconds, cpu_seconds=spent, peak_gigabytes=peak
    )


def _forget_peak() -> None:
    """Let the system count the peak of memory from now on; not every one can."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def _measured(given: Given, made: Made) -> dict[str, float | None]:
    measures = scores(made.drawn(given), drawn(given.scene, given), given.truth)
    return {**measures, "contact": _contact(given, made)}


def _contact(given: Given, made: Made) -> float | None:
    """The foot of the thing above where it belongs, as a share of the thing's height; negative
    where it sank."""
    if made.own is None or made.scene is None or not made.own.any():
        return None
    part = given.other if given.other is not None else given.scene[given.inside]
    true = torch.from_numpy(place_of(given.case).points(part.means.numpy()))[:, 2]
    found = made.scene.means[made.own, 2].double()
    height = float(true.max() - true.min())
    return float(found.quantile(FOOT) - true.quantile(FOOT)) / height


def _read_result(folder: Path, given: Given) -> Made | None:
    """Somebody's result: CASE.ply, or pictures CASE/000.png of the held-out views."""
    name = given.case.name
    if (folder / f"{name}.ply").is_file():
        return Made(load(folder / f"{name}.ply"))
    paths = [folder / name / f"{i:03d}.png" for i in range(len(given.held_out))]
    if all(path.is_file() for path in paths):
        return Made(pictures=torch.stack([read_picture(path) for path in paths]))
    return None


def _clicks(folder: Path, name: str, size: Size, result: Path | None) -> Iterator[Row]:
    whole, given, cameras = _scene(folder, name, size)
    for thing in whole.things:
        case = f"select-{name}-{thing.name.replace(' ', '-')}"
        true = given.of(thing.name)
        if result is None:
            for method, select in CLICKING.items():
                work = partial(clicking, whole, given, thing.name, cameras, select)
                yield _timed(Row(case, "click", method), work, _by_clicks)
        elif (result / f"{case}.npy").is_file():
            flags = torch.from_numpy(read_flags(result / f"{case}.npy", len(true)))
            yield Row(case, "click", RESULT, {"iou": iou(flags, true)})


def _by_clicks(found: list[float]) -> dict[str, float | None]:
    return {f"iou_{i + 1}": value for i, value in enumerate(found)}


def _phrases(folder: Path, name: str, size: Size) -> Iterator[Row]:
    _, given, cameras = _scene(folder, name, size)

    def measured(true: Bool[Tensor, " n"], found: Bool[Tensor, " n"]) -> dict[str, float | None]:
        return {"iou": iou(found, true)}

    for phrase, thing in NAMED[name]:
        work = partial(select_phrase, given.scene, cameras, phrase)
        row = Row(f"{name}: {phrase}", "phrase", OURS)
        yield _timed(row, work, partial(measured, given.of(thing)))
    for stage, phrase in REFUSED:
        if stage == name:
            work = partial(_is_refused, given.scene, cameras, phrase)
            row = Row(f"{name}: {phrase}", "refusal", OURS)
            yield _timed(row, work, lambda refused: {"refused": float(refused)})


def _is_refused(scene: Gaussians, cameras: Sequence[Camera], phrase: str) -> bool:
    try:
        select_phrase(scene, cameras, phrase)
    except UsageError:
        return True
    return False


def _scene(folder: Path, name: str, size: Size) -> tuple[Stage, Labelled, tuple[Camera, ...]]:
    whole, source = on_black(name), folder / "scenes" / name
    write_scene(whole, source, size)
    return whole, read_labelled(source), whole.training(size.side)
