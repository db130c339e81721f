"""How much sooner two ranks are done than one (strong scaling), and how much more they do in the
same time (weak scaling): a thread each, on one machine.

`ranks_to_folder` starts this file once for each rank, with each number of ranks in turn.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from gsedit.bench.provenance import Provenance, provenance
from gsedit.bench.results import markdown_table, write_measurements, write_text
from gsedit.errors import GseditError
from gsedit.runs.events import Event
from gsedit.runs.ranks import Ranks, join, variables_of

ROWS, TABLE = "bench.jsonl", "bench.md"
VIEWS, SIDE = 4, 192
"""Views of the strong cases, pixels a side; a rank has half of them in the weak ones."""
GAUSSIANS = 6000
SUMMED = 1_000_000
"""Numbers of a gradient, 4 MB: colors and opacities of 77,000 Gaussians of SH degree 1."""


@dataclass(frozen=True)
class RanksMeasurement:
    """Median seconds of a case over the runs."""

    case: str
    scaling: str
    """strong: the same work whatever the ranks; weak: as much for each rank; message: sent once."""
    ranks: int
    seconds: float
    taken_with: Provenance


def ranks_to_folder(
    folder: Path, *, ranks: Sequence[int] = (1, 2), runs: int = 3, quick: bool = False
) -> Iterator[Event | RanksMeasurement]:
    """Measure with these numbers of ranks, run by run in turn; writes bench.jsonl and bench.md.

    Raises GseditError where a run fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[RanksMeasurement] = []
    yield from write_measurements(_measured(ranks, runs, quick), folder / ROWS, rows)
    write_text(folder / TABLE, table(rows) + "\n")


def table(rows: Sequence[RanksMeasurement]) -> str:
    """A row a case: seconds by ranks, and the first over the last."""
    counts = sorted({row.ranks for row in rows})
    cells = []
    for case, scaling in dict.fromkeys((row.case, row.scaling) for row in rows):
        seconds = {r.ranks: r.seconds for r in rows if (r.case, r.scaling) == (case, scaling)}
        measured = [f"{seconds[n]:.3f}" if n in seconds else "" for n in counts]
        ratio = ""
        if scaling != "message" and len(seconds) > 1:
            ratio = f"{seconds[counts[0]] / seconds[counts[-1]]:.2f}"
        cells.append([f"{case}, {scaling}", *measured, ratio])
    return markdown_table(["", *(f"{n} ranks, s" for n in counts), "first / last"], cells)


def _measured(ranks: Sequence[int], runs: int, quick: bool) -> Iterator[Event | RanksMeasurement]:
    found: dict[tuple[str, str, int], list[float]] = {}
    began, total = time.monotonic(), runs * len(ranks)
    for run in range(runs):
        for k, count in enumerate(ranks):
            for case, scaling, seconds in _run(count, quick):
                found.setdefault((case, scaling, count), []).append(seconds)
            done = run * len(ranks) + k + 1
            yield Event("ranks", time.monotonic() - began, done, total, note=f"{count} ranks")
    taken_with = replace(provenance(), threads=1)
    for (case, scaling, count), seconds in found.items():
        yield RanksMeasurement(case, scaling, count, median(seconds), taken_with)


def _run(count: int, quick: bool) -> list[tuple[str, str, float]]:
    """(case, scaling, seconds) of a run with that many ranks. Raises GseditError."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "found.json"
        command = [sys.executable, "-m", __spec__.name, str(out), *(["--quick"] * quick)]
        own = {**os.environ, "OMP_NUM_THREADS": "1"}
        started = [
            subprocess.Popen(
                command,
                env={**own, **variables_of(rank, count, Path(folder))},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            for rank in range(count)
        ]
        said = [process.communicate()[1] for process in started]
        for process, words in zip(started, said):
            if process.returncode:
                raise GseditError(f"a run with {count} ranks failed: {words.strip()[:2000]}")
        return [tuple(row) for row in json.loads(out.read_text())]


# ---- what each rank runs ------------------------------------------------------------------------


def work(ranks: Ranks, quick: bool) -> list[tuple[str, str, float]]:
    """(case, scaling, seconds) of every case."""
    import torch

    from gsedit.cameras.orbit import circle
    from gsedit.datasets.dataset import Dataset, capture
    from gsedit.synthetic import demo_scene, surface_gaussians

    solid, size = demo_scene(), ranks.size
    scene = surface_gaussians(solid, GAUSSIANS, torch.Generator().manual_seed(1))
    cameras = circle(
        torch.zeros(3, dtype=torch.float64), 0.7, solid.up, 9, SIDE,
        elevation=20.0, fov=45.0,
    )  # fmt: skip
    views = capture(scene, cameras, [f"view_{i}" for i in range(9)])
    data = Dataset(views, scene.means.double())
    steps = 2 if quick else 8
    half = VIEWS // 2
    cases: dict[tuple[str, str], Callable[[], None]] = {
        ("2D editor", "strong"): lambda: _edit(ranks, data, VIEWS, steps),
        ("2D editor", "weak"): lambda: _edit(ranks, data, half * size, steps),
        ("update", "strong"): lambda: _update(ranks, scene, data, VIEWS, 5 * steps),
        ("update", "weak"): lambda: _update(ranks, scene, data, half * size, 5 * steps),
        ("fit", "strong"): lambda: _fit(ranks, data, 2, 5 * steps),
        ("fit", "weak"): lambda: _fit(ranks, data, size, 5 * steps),
        ("gather 4 predictions of 3 x 64 kB", "message"): lambda: _gather(ranks),
        ("sum gradients of 4 MB", "message"): lambda: ranks.add_up([torch.zeros(SUMMED)]),
    }
    _edit(ranks, data, half * size, 1)  # the first pass of a network is slower
    return [(*name, _seconds(ranks, case)) for name, case in cases.items()]


def _seconds(ranks: Ranks, case: Callable[[], None]) -> float:
    """Seconds of the slowest rank: all begin and end together."""
    ranks.first(None)
    began = time.perf_counter()
    case()
    ranks.first(None)
    return time.perf_counter() - began


def _edit(ranks: Ranks, data, views: int, steps: int) -> None:
    import torch

    from gsedit.diffusion.settings import SamplerSettings
    from gsedit.editors import EditBatch, make_editor
    from gsedit.editors.ranked import with_ranks

    images = torch.stack([data.views[i % len(data.views)].image for i in range(views)])
    editor = with_ranks(make_editor("small"), ranks)
    settings = SamplerSettings(steps=steps, precision="float32")
    for _ in editor.edit(EditBatch(images, images, "as gold"), settings, torch.Generator()):
        pass


def _update(ranks: Ranks, scene, data, patches: int, steps: int) -> None:
    import torch

    from gsedit.fitting.optimizer import SceneOptimizer
    from gsedit.fitting.settings import UpdateSettings
    from gsedit.fitting.update import Target, rates, update_steps
    from gsedit.measures.features import FilterBank

    optimizer = SceneOptimizer(scene, rates("appearance", 1.0), ranks=ranks)
    targets = [Target(replace(view, image=1 - view.image)) for view in data.views]
    seen = torch.ones(len(scene), dtype=torch.bool)
    settings = UpdateSettings(patches=patches)
    for _ in update_steps(
        optimizer, targets, seen, range(steps), steps, settings, FilterBank(),
        torch.Generator().manual_seed(0),
    ):  # fmt: skip
        pass


def _fit(ranks: Ranks, data, batch: int, steps: int) -> None:
    import torch

    from gsedit.fitting.fit import fit_steps
    from gsedit.fitting.settings import FitSettings

    settings = FitSettings(steps=steps, seconds=None, batch=batch, coarse=(), evaluations=1)
    for _ in fit_steps(data, settings, generator=torch.Generator().manual_seed(0), ranks=ranks):
        pass


def _gather(ranks: Ranks) -> None:
    """Send as much as one step of Stable Diffusion's sampler does for 4 views at 512x512."""
    import torch

    ranks.rows(lambda rows: rows, torch.zeros(VIEWS, 3, 4, 64, 64))


if __name__ == "__main__":
    here = join()
    measured = work(here, "--quick" in sys.argv)
    if not here.rank:
        Path(sys.argv[1]).write_text(json.dumps(measured))
    here.leave()
    os._exit(0)  # threads of the connection could abort an orderly exit
