"""Error against run time of every stage, in one picture: `python -m research.error_time FOLDER`.

Each stage runs at a few settings of its knob on small synthetic inputs, on one thread; the error is
the distance from an exact answer. Writes error-time.csv and error_time.png into the folder; stages
that the .csv has already are not run again.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import torch
from torch import Tensor

import gsedit
from gsedit import FitSettings, fit
from gsedit.datasets.dataset import View, capture
from gsedit.fitting.solve import solve_colors
from gsedit.materials.apply import in_material
from gsedit.materials.named import MATERIALS
from gsedit.meshing import mesh
from gsedit.objects.removal.remove import remove
from gsedit.storage.atomic import atomic_path
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians, traced_dataset
from gsedit.synthetic.scene import SyntheticScene
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians
from research.curves import slope
from research.figures import frame, plain_ticks, save_png
from research.fit.captures import room
from research.measure_meshes import errors, ring_views, seen_points
from research.sampler.solver_study import solver_study

HEAD = ("stage", "knob", "setting", "CPU s", "error", "unit")
SIZE = 96


class Row(NamedTuple):
    """One setting of one stage; see HEAD."""

    stage: str
    knob: str
    setting: str
    seconds: float
    error: float
    unit: str


T = TypeVar("T")


def timed(work: Callable[[], T]) -> tuple[float, T]:
    """Return CPU seconds and the result of some work."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def rmse(ours: list[Tensor], theirs: list[Tensor]) -> float:
    """Root mean square difference of pictures, colors in [0, 1]."""
    return float(torch.stack([(a - b).square().mean() for a, b in zip(ours, theirs)]).mean().sqrt())


def pictures(scene: Gaussians, cameras: Sequence[Camera]) -> list[Tensor]:
    with torch.no_grad():
        return [render(scene, camera).color for camera in cameras]


def splats(solid: SyntheticScene, count: int) -> Gaussians:
    return surface_gaussians(solid, count, torch.Generator().manual_seed(0))


def rendering() -> Iterator[Row]:
    """Samples a pixel against 16 x 16: edges are where one sample errs."""
    scene = splats(demo_scene(), 2000)
    [camera] = ring_cameras(demo_scene(), 1, SIZE)

    def sampled(side: int) -> Tensor:
        lens = {name: side * getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
        finer = replace(camera, **lens, width=SIZE * side, height=SIZE * side)
        [color] = pictures(scene, [finer])
        return color.reshape(SIZE, side, SIZE, side, 3).mean((1, 3))

    exact = sampled(16)
    sampled(1)
    for side in (1, 2, 4, 8):
        seconds, found = timed(lambda side=side: sampled(side))
        yield Row(
            "render", "samples a pixel", str(side**2), seconds, rmse([found], [exact]), "RMSE"
        )


def fitting() -> Iterator[Row]:
    """Steps of a fit; the error is at four cameras that no photo was taken from."""
    solid = demo_scene()
    photos = traced_dataset(solid, ring_cameras(solid, 24, SIZE))
    unseen = traced_dataset(solid, ring_cameras(solid, 4, SIZE, elevation=25.0, start=7.0))
    truth, cameras = [v.image for v in unseen.views], [v.camera for v in unseen.views]
    for steps in (30, 100, 300, 800):
        settings = FitSettings(steps=steps, seconds=None, evaluations=1, max_gaussians=40_000)
        seconds, result = timed(lambda settings=settings: fit(photos, settings))
        found = pictures(result.scene, cameras)
        yield Row("fit", "steps", str(steps), seconds, rmse(found, truth), "RMSE, unseen views")


def solving() -> Iterator[Row]:
    """Iterations of the solve of colors, against the residual where it ends."""
    scene = splats(demo_scene(), 4000)
    views = capture(scene, ring_cameras(demo_scene(), 8, SIZE), [str(i) for i in range(8)])
    targets = [View(v.name, v.camera, v.image.flip(-1).square()) for v in views]
    inside = torch.ones(len(scene), dtype=torch.bool)
    began, spent, solutions = time.process_time(), [], []
    for each in solve_colors(scene, targets, inside, most_iterations=60, least_gain_db=-99.0):
        spent.append(time.process_time() - began)
        solutions.append(each.mse)
    for count in (1, 2, 4, 8, 16):
        error = max(solutions[count - 1] - solutions[-1], 0) ** 0.5
        yield Row("solve of colors", "iterations", str(count), spent[count - 1], error, "RMSE")


def sampling() -> Iterator[Row]:
    """Steps of the default solver against the exact path of a mixture of Gaussians."""
    for row in solver_study([0.1], [7.5], [10, 20, 40, 80], runs=21):
        if row.variant == "dpm++2m" and row.error is not None:
            error = float(row.error)
            yield Row("sampler", "steps", str(row.steps), row.seconds, error, "standard deviations")


def dressing() -> Iterator[Row]:
    """Gaussians of a bronze bear, against the one of 32,000."""
    cameras = ring_cameras(demo_scene(), 6, SIZE)

    def bronze(count: int) -> Gaussians:
        scene = splats(demo_scene(), count)
        inside = torch.ones(len(scene), dtype=torch.bool)
        return in_material(scene, inside, MATERIALS["bronze"], cameras).scene

    exact = pictures(bronze(32_000), cameras)
    for count in (500, 2000, 8000):
        seconds, found = timed(lambda count=count: bronze(count))
        error = rmse(pictures(found, cameras), exact)
        yield Row("material", "Gaussians", f"{count:,}", seconds, error, "RMSE to 32,000")


def removing() -> Iterator[Row]:
    """Gaussians of a bear in a room that is removed, against traced pictures of the bare room."""
    full, bear = room(demo_scene()), demo_scene()
    bare = room(replace(bear, sdf=lambda points: points.norm(dim=-1) + 10))
    cameras = ring_cameras(replace(full, radius=1.3), 8, SIZE, elevation=30.0)
    truth = [bare.trace(camera, 2).image.float() for camera in cameras[:3]]
    for count in (5000, 20_000, 60_000):
        scene = splats(full, count)
        inside = bear.sdf(scene.means.double()) < 0.02
        seconds, found = timed(lambda s=scene, i=inside: remove(s, i, cameras))
        error = rmse(pictures(found.scene, cameras[:3]), truth)
        yield Row("removal", "Gaussians", f"{count:,}", seconds, error, "RMSE")


def meshing() -> Iterator[Row]:
    """Gaussians that a mesh is made of, against the exact surface."""
    solid = demo_scene()
    cameras = ring_views(solid)[::3]
    seen = seen_points(solid, cameras)
    mesh(splats(solid, 500), cameras)  # the first loads libraries
    for count in (500, 2000, 8000):
        scene = splats(solid, count)
        seconds, found = timed(lambda scene=scene: mesh(scene, cameras))
        error = errors(found, solid, seen)[0] / 100
        yield Row("mesh", "Gaussians", f"{count:,}", seconds, error, "Chamfer, diameters")


def converting() -> Iterator[Row]:
    """Formats that a scene is written in and read from, against its pictures before."""
    scene = splats(demo_scene(), 50_000)
    cameras = ring_cameras(demo_scene(), 4, SIZE)
    truth = pictures(scene, cameras)
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".splat", ".compressed.ply", ".spz", ".sog"):
            path = Path(folder) / f"a{suffix}"
            seconds, _ = timed(lambda path=path: gsedit.save(scene, path))
            more, found = timed(lambda path=path: gsedit.load(path))
            error = rmse(pictures(found, cameras), truth)
            yield Row("convert", "format", suffix, seconds + more, error, "RMSE")


STAGES = {
    "render": rendering, "fit": fitting, "solve of colors": solving, "sampler": sampling,
    "material": dressing, "removal": removing, "mesh": meshing, "convert": converting,
}  # fmt: skip


def plot(rows: list[Row], path: Path) -> None:
    """Write one panel a stage: error over CPU seconds, both logarithmic, settings beside points."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure, panels = plt.subplots(2, 4, figsize=(13, 6.2), layout="constrained")
    for stage, axes in zip(STAGES, panels.flat):
        own = [row for row in rows if row.stage == stage]
        if not own:
            axes.set_visible(False)
            continue
        own = [row for row in own if row.error]  # of an exact format there is none
        x, y = [row.seconds for row in own], [row.error for row in own]
        axes.loglog(x, y, "o" if stage == "convert" else "o-", color="#1f6f8b", markersize=5)
        for number, (row, a, b) in enumerate(zip(own, x, y)):
            below = stage == "convert" and number % 2
            place = (0, -14) if below else (5, 5)
            axes.annotate(row.setting, (a, b), place, textcoords="offset points", fontsize=8)
        axes.margins(x=0.25, y=0.2)
        power = "" if stage == "convert" else f"; slope {slope(list(zip(x, y))):.1f}"
        frame(axes, stage, 11)
        axes.set_xlabel(f"CPU seconds (points: {own[0].knob}{power})", fontsize=8)
        axes.set_ylabel(own[0].unit, fontsize=8)
        axes.tick_params(labelsize=8)
        plain_ticks(axes)
        low, high = axes.get_ylim()
        axes.yaxis.set_major_locator(LogLocator(subs=(1,) if high / low > 300 else (1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    save_png(figure, path, overwrite=True)
    plt.close(figure)


def main(out: Path) -> None:
    """Measure the stages that the .csv does not have yet; write it and the picture."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    file, rows = out / "error-time.csv", []
    if file.exists():
        with file.open() as text:
            known = list(csv.reader(text))[1:]
        rows = [Row(a, b, c, float(d), float(e), f) for a, b, c, d, e, f in known]
    for stage, measure in STAGES.items():
        if stage in {row.stage for row in rows}:
            continue
        rows += [row for row in measure() if print(row, flush=True) is None]  # noqa: T201
        with atomic_path(file, overwrite=True) as temporary, temporary.open("w") as text:
            written = [
                (*row[:3], f"{row.seconds:.3g}", f"{row.error:.3g}", row.unit) for row in rows
            ]
            csv.writer(text, lineterminator="\n").writerows([HEAD, *written])
    plot(rows, out / "error_time.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
