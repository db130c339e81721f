"""Edits of a scene, and of copies of it side by side: seconds, memory, and what they cost."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.results import markdown_table, write_measurements, write_text
from gsedit.datasets.dataset import evenly_spaced
from gsedit.datasets.load import load_dataset
from gsedit.formats.edit_records import read_edit_record
from gsedit.formats.scenes import load, save
from gsedit.measures.metrics import psnr
from gsedit.runs.events import Event
from rasterizer.render import render
from rasterizer.scene import Gaussians
from research.clocked import gsedit
from research.scale.copies import side_by_side

ROWS, TABLE = "scale.jsonl", "scale.md"
WHOLE = " --disable merging"
"""At the end of the words of an edit: it is compared with the edit of the same words before it."""
COMPARED = 4
"""Held-out views at which edits are compared."""


@dataclass(frozen=True)
class ScaleSettings:
    """A scene, its edits, and numbers of its copies."""

    scene: Path
    data: Path
    edits: tuple[str, ...]
    """Words of `gsedit edit` behind the scene, as a shell takes them."""
    copies: tuple[int, ...]
    """How many of the scene stand side by side: 1 and more."""
    size: int = 256
    """Longer side of the views, pixels."""


@dataclass(frozen=True)
class ScaleMeasurement:
    """One edit, in a process of its own: from reading files to writing them."""

    edit: str
    gaussians: int
    degree: int
    seconds: float
    stages: dict[str, float]
    """Seconds by stage, as edit.json has them."""
    peak_gb: float
    """Largest resident memory, 1e9 bytes."""
    psnr_to_held_out_edits: float | None
    kept: float | None
    psnr_of_edits: float | None
    """PSNR of the photographed copy, alone, to the edit of the scene without others, at held-out
    views, dB. None where rows were removed or added, so that the copy cannot be told by them."""


def measure_scale(settings: ScaleSettings, folder: Path) -> Iterator[Event | ScaleMeasurement]:
    """One measurement a number of copies and edit.

    Raises GseditError where an edit fails, with its last line.
    """
    views = load_dataset(settings.data, size=settings.size).split()[1]
    cameras = [views[i].camera for i in evenly_spaced(len(views), COMPARED)]

    def pictures(scene: Gaussians) -> list[Float[Tensor, "h w 3"]]:
        with torch.no_grad():
            drawn = (render(scene, camera).color for camera in cameras)
            return [picture.clamp(0, 1) for picture in drawn]

    rows = len(load(settings.scene))
    first: dict[str, list[Float[Tensor, "h w 3"]]] = {}
    sizes = {1: (settings.scene, rows)}
    tasks = [
        (copies, words) for copies in sorted({1, *settings.copies}) for words in settings.edits
    ]
    for index, (copies, words) in enumerate(tasks):
        yield Event("scale", 0.0, index, len(tasks), note=f"{copies} copies: {words}")
        if copies not in sizes:
            sizes[copies] = _save_copies(settings.scene, copies, folder)
        path, count = sizes[copies]
        out = folder / f"edit_{copies}_{settings.edits.index(words)}"
        seconds, peak = _edit(settings, words, path, out)
        edited, record = load(out / "scene.ply"), read_edit_record(out / "edit.json")
        own = pictures(edited[:rows]) if len(edited) == count else None
        merged = words.removesuffix(WHOLE)
        if own is not None:
            first.setdefault(merged, own)
        yield ScaleMeasurement(
            edit=words,
            gaussians=count,
            degree=edited.degree,
            seconds=seconds,
            stages=record["timings"],
            peak_gb=peak,
            psnr_to_held_out_edits=_held_out(record, "psnr_to_targets"),
            kept=_held_out(record, "psnr_outside_region"),
            psnr_of_edits=None if own is None else _mean_psnr(own, first[merged]),
        )


def _save_copies(scene: Path, copies: int, folder: Path) -> tuple[Path, int]:
    """The file of so many copies side by side, and its number of Gaussians."""
    many, path = side_by_side(load(scene), copies), folder / f"scene_{copies}.ply"
    save(many, path, overwrite=True)
    return path, len(many)


def _held_out(record: dict[str, Any], name: str) -> float | None:
    """The mean of a metric at held-out views, as edit.json has it; None where it has none."""
    mean = record["measured"].get(name, {}).get("held_out")
    return None if mean is None else mean["value"]


def scale_to_folder(folder: Path, settings: ScaleSettings) -> Iterator[Event | ScaleMeasurement]:
    """All measurements, written to a folder: ROWS meanwhile, then TABLE."""
    rows: list[ScaleMeasurement] = []
    folder.mkdir(parents=True, exist_ok=True)
    yield from write_measurements(measure_scale(settings, folder), folder / ROWS, rows)
    write_text(folder / TABLE, table(rows) + "\n")


def table(rows: Sequence[ScaleMeasurement]) -> str:
    """The measurements for people."""
    stages = list(dict.fromkeys(name for row in rows for name in row.stages if name != "total"))
    head = ("edit", "Gaussians", "SH", "seconds", *stages, "peak GB", "held-out edits dB",
            "kept dB", "to the edit of one, dB")  # fmt: skip
    return markdown_table(
        head,
        [
            (
                row.edit,
                f"{row.gaussians:,}",
                str(row.degree),
                f"{row.seconds:.0f}",
                *(f"{row.stages.get(name, 0.0):.0f}" for name in stages),
                f"{row.peak_gb:.2f}",
                *(
                    "-" if value is None or value > 99 else f"{value:.2f}"
                    for value in (row.psnr_to_held_out_edits, row.kept, row.psnr_of_edits)
                ),
            )
            for row in rows
        ],
    )


def _edit(settings: ScaleSettings, words: str, scene: Path, out: Path) -> tuple[float, float]:
    """Seconds and gigabytes of `gsedit edit`. Raises GseditError where it fails."""
    ran = gsedit(
        "edit", scene, *shlex.split(words), "--data", settings.data, "--size", settings.size,
        "-o", out, "--force",
    )  # fmt: skip
    return ran.seconds, ran.gigabytes


def _mean_psnr(
    pictures: Sequence[Float[Tensor, "h w 3"]], others: Sequence[Float[Tensor, "h w 3"]]
) -> float:
    """Decibels; 100 at most: JSON has no infinity."""
    values = [min(100.0, psnr(one, other)) for one, other in zip(pictures, others)]
    return sum(values) / len(values)
