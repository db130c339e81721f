"""Try the claims of Efficient-NeRF2NeRF with a network that paints: `python -m research.painting`.

    python -m research.painting OUT bear.ply garden.ply dinosaur.ply
    python -m research.painting OUT --judge ../docs/measurements/data/paper.csv

The paper's editor is InstructPix2Pix. Here it is a published network of instance normalisation
(Dumoulin et al. 2017), which contradicts itself between views three times as much as renders do:
the paper's problem. Cells: the styles of STYLES times the scenes. Pictures have 192 pixels; 18
planned views are painted; the meters look at four cameras that are never painted, beside what the
network paints of each of these alone. One thread; seconds are the processor's.

Meters, chosen before any run. *energy*: mean squared gradient over the truth's. *perceptual*:
distance of the shift-tolerant AlexNet to the truth. *gram*: relative distance of Gram matrices of
VGG (four layers), while the losses have a bank of filters. *likeness*: cosine of the style
predictor's 100 numbers to the truth's, in place of CLIP. *disagreement*: difference of colors at
SIFT points over that of the unedited scene, among painted views ("target") or near renders. PSNR is
kept and decides nothing: it prefers blur.

Hypotheses, and what would refute each (`claims` of judge.py has them as tests). An effect is a mean
over cells with its interval of 95 %; "opposite" is said only where the interval is beyond zero on
the other side, and "not seen" where it has zero in it.

1. Averaging corresponding features makes painted views agree. Refuted unless target disagreement
   falls, averaged after all 6 residual blocks, and falls below that of the same views painted
   without it and blurred to the same energy.
2. Averaging to the end blurs, ending early avoids it (T_end). Refuted unless painted views have
   less energy with 6 blocks than with 1, and with 1 at least 0.9 of that with none.
3. A few views suffice. Refuted if 18 planned ones are farther in perceptual distance than all by
   0.02 or more, or are no nearer than 18 random ones.
4. The single pass is ahead of the iterative update at equal seconds. Refuted unless nearer in
   perceptual distance after 5 and after 10 s, with the same loss, rate and start.
5. It is 10 times faster: what the single pass reaches in 5 s the iterative update needs 10 times
   the cost for, at the paper's prices (7.5 s an edited view, 0.15 s a step) and at ours.
6. Its quality is comparable in the end (20 s): refuted if farther by 0.02 or more in perceptual
   distance or by 0.05 in energy than the iterative update. (Since the runs: not judged where that
   one had not painted every view twice.)
7. Single pass, then iterative, is best. Refuted unless nearer than both in the end (20 s).
8. MSE + Gram keeps the style. Refuted unless nearer than MSE alone in perceptual distance and gram,
   from the same solved scene by as many steps, and in 10 of 12 cells.
9. So does a random switch between the two. Refuted unless nearer than MSE alone in both.
10. The curve of CLIP: likeness rises sooner in the single pass (after 5 and 10 s).
11. MSE + Gram is sharper and nearer in style than L1 + LPIPS. Refuted unless energy is higher and
    gram less. The perceptual distance cannot judge: that loss minimises it.
12. A style of a scene takes 30 s. Not reached unless the whole edit takes less, has an energy of
    0.5 or more and a perceptual distance of 0.45 or less.

gsedit's own parts beside them: one leading view against a plain solve, pooled statistics against
each view's own, planned against random views, the solve against Adam from the unedited scene.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import torch
import typer

from gsedit.errors import UsageError
from gsedit.paper.editors.painter.editor import load_painter
from research.command import print_message, print_result, run
from research.painting.arms import ARMS, BASE, LATER, REPAINT, Arm, Bench
from research.painting.cases import Case, Meter, load_case
from research.painting.judge import FIELDS, STRATEGIES, draw, number, read_records, report

STYLES = ("starry night painting", "yellow ink", "wave print", "expressionist")
CURVED = ("starry night painting", "wave print")
"""Styles in which strategies run: a curve takes as long as all other arms of a cell."""
AT = (5.0, 10.0, 20.0)
"""Processor seconds at which strategies are measured."""
RECORDS, TABLE, FIGURE = "records.csv", "claims.md", "paper.png"

Task = tuple[str, str, Arm | str]
"""Scene, style, and an arm or the name of a strategy."""


def tasks(scenes: Sequence[str], styles: Sequence[str]) -> Iterator[Task]:
    """All work, the most needed first: an interrupted run has something to say on every claim."""
    cells = [(scene, style) for style in styles for scene in scenes]
    curved = [cell for cell in cells if cell[1] in CURVED]
    yield from ((*cell, arm) for cell in cells for arm in ARMS)
    yield from ((*cell, name) for cell in curved for name in STRATEGIES)
    yield from ((*cell, arm) for arm in LATER for cell in [*curved, *cells])
    yield from ((*cell, REPAINT) for cell in curved)


class Recorder:
    """Runs tasks that have no record yet, and appends their records."""

    def __init__(self, path: Path, scenes: Sequence[Path]) -> None:
        self.path, self.paths = path, {scene.stem: scene for scene in scenes}
        rows = read_records(path) if path.is_file() else []
        self.done = {(r["scene"], r["style"], r["arm"], r["seed"], r["at"]) for r in rows}
        self.cases: dict[str, Case] = {}
        self.benches: dict[tuple[str, str], tuple[Bench, Meter]] = {}

    def work(self, task: Task) -> None:
        """Run a task, unless it is done."""
        scene, style, arm = task
        name, seed = (arm, 0) if isinstance(arm, str) else (arm.name, arm.seed)
        at = AT[-1] if isinstance(arm, str) else None
        if (scene, style, name, seed, at) in self.done:
            return
        self.done.add((scene, style, name, seed, at))
        bench, meter = self.bench(scene, style)
        head = {"scene": scene, "style": style, "arm": name, "seed": seed}
        if isinstance(arm, str):
            for until, found in zip(AT, bench.strategy(arm, AT)):
                counts = {"seconds": found.seconds, "steps": found.steps, "edits": found.edits}
                self.write({**head, "at": until, **counts, **meter(found.scene)})
            return
        found = bench.fitted(arm)
        own = bench.agreement(arm) if arm.views == "planned" else {}
        counts = {"seconds": found.seconds, "steps": found.steps, "edits": found.edits}
        prepared = {"prepared": bench.case.seconds}
        self.write({**head, **counts, **prepared, **meter(found.scene), **own})
        if arm == BASE:
            self.write({**head, "arm": "unedited", **meter(bench.case.scene)})

    def bench(self, scene: str, style: str) -> tuple[Bench, Meter]:
        """The arms and meters of a cell."""
        if scene not in self.cases:
            self.cases[scene] = load_case(self.paths[scene])
        if (scene, style) not in self.benches:
            case, painter = self.cases[scene], load_painter()
            self.benches[scene, style] = Bench(case, painter, style), Meter(case, painter, style)
        return self.benches[scene, style]

    def write(self, row: dict[str, object]) -> None:
        """Append a record: it is on disk before the next task."""
        fresh = not self.path.is_file()
        with self.path.open("a", newline="") as file:
            writer = csv.DictWriter(file, list[str](FIELDS))
            if fresh:
                writer.writeheader()
            writer.writerow({key: number(value) for key, value in row.items()})
        print_message(" ".join(f"{key} {number(value)}" for key, value in row.items()))


def painting(
    out: Annotated[Path, typer.Argument(help="Folder for records, table and figure.")],
    scenes: Annotated[
        list[Path] | None, typer.Argument(help="Scenes with cameras.json beside them.")
    ] = None,
    styles: Annotated[list[str] | None, typer.Option("--style", help="Styles; all four.")] = None,
    judge: Annotated[
        Path | None, typer.Option("--judge", help="Judge these records, run nothing.")
    ] = None,
) -> None:
    """Run what has no record in OUT yet, and judge the claims by all records."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    records = judge or out / RECORDS
    if judge is None:
        if not scenes:
            raise UsageError("name the scenes after OUT, or give --judge RECORDS")
        recorder = Recorder(records, scenes)
        for task in tasks([path.stem for path in scenes], styles or STYLES):
            recorder.work(task)
    rows = read_records(records)
    text = report(rows)
    (out / TABLE).write_text(text + "\n")
    draw(rows, out / FIGURE)
    print_result(text)


if __name__ == "__main__":
    run(painting)
