"""One run of the paper's experiments: what is edited how, and the record that it leaves as JSON."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gsedit.bench.results import write_text
from gsedit.errors import InputError
from gsedit.run.json_files import read_json
from gsedit.run.json_lines import plain
from research.paper.observe import Point, nearest_truth


@dataclass(frozen=True)
class Case:
    """A scene with its views and an instruction."""

    name: str
    prompt: str
    size: int
    """Pixels, the longer side of the views."""
    patches: int
    """Crops a fitting step renders."""
    patch: int
    """Side of a crop, pixels."""
    gaussians: int = 0
    """Number of Gaussians of a synthetic scene, found by its name; 0 for a capture."""
    views: int = 0
    """Cameras on a ring around a synthetic scene; every eighth is held out."""
    scene: str = ""
    """File of a capture."""
    data: str = ""
    """Folder of its photos; none: views are found."""


@dataclass(frozen=True)
class Arm:
    """How a scene is edited: a preset, a strategy, and what differs from them."""

    label: str
    preset: str = "default"
    strategy: str = "single-pass"
    options: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the strategy."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of EditSettings; of its records with a dot: sampler.t_end, update.loss."""


@dataclass(frozen=True)
class Run:
    """An arm on a case, with one editor and seed."""

    arm: Arm
    case: Case
    editor: str
    seed: int

    @property
    def key(self) -> str:
        """Name of its files: equal for equal work, whatever the arm is called."""
        work = {**asdict(self), "arm": {**asdict(self.arm), "label": ""}}
        digest = hashlib.sha256(json.dumps(plain(work), sort_keys=True).encode()).hexdigest()[:12]
        return f"{self.arm.strategy}-{self.case.name}-{self.editor}-{self.seed}-{digest}"


@dataclass(frozen=True)
class Record:
    """Result of one run."""

    curve: tuple[Point, ...]
    truth: str
    """Reference of the errors: variants of the exact edit, or the editor's own pictures."""
    disagreement: float | None
    """RMSE between the edited pictures of near views, warped onto each other; None: no pair."""
    unedited_disagreement: float | None
    """Disagreement of renders of the unedited scene."""
    matched: float | None
    """Mean share of latent cells matched between two views of a batch."""
    target_error: float | None
    """RMSE of the edited pictures to the variant of the exact edit that they are nearest to; None
    where it is unknown."""
    residual: float | None
    """RMSE of the edited scene to the edited pictures."""
    target_sharpness: float
    """Gradient energy of the edited pictures, over that of the exact edit (else the unedited)."""
    sharpness: float
    """Gradient energy of the edited scene at held-out cameras, over that of the reference."""
    cpu: float
    """Processor seconds of the whole run, its measurements included."""
    threads: int
    commit: str
    machine: str
    date: str

    @property
    def errors(self) -> tuple[float, ...]:
        """RMSE of each point, to the variant that the edit ends nearest to."""
        nearest = nearest_truth(self.curve)
        return tuple(point.errors[nearest] for point in self.curve)


def write_record(path: Path, run: Run, record: Record) -> None:
    """A JSON file, all of it or nothing."""
    text = json.dumps({"run": plain(run), "record": plain(record)}, indent=1, allow_nan=False)
    write_text(path, text + "\n")


def read_record(path: Path) -> Record:
    """Read a record that `write_record` wrote. Raises InputError."""
    try:
        fields = read_json(path)["record"]
        curve = [Point(**{**p, "errors": tuple(p["errors"])}) for p in fields["curve"]]
        return Record(**{**fields, "curve": tuple(curve)})
    except (InputError, ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{path}: not a run of research.paper ({error}); delete it, and it is run again"
        ) from error
