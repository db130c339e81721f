"""Commands on degenerate scenes: how each ends, whether the result is finite, what is said.

`python -m research.measure_degenerate FOLDER` prints two tables: the solve of colors against the
exact minimum in float64, and commands on scenes of one Gaussian, of equal rows, of needles, ...
"""

from __future__ import annotations

import contextlib
import csv
import importlib
import io
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

import gsedit
from gsedit.bench.results import markdown_table, write_text
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.dataset import View, capture
from gsedit.fitting.solve import BAND_PENALTY, PENALTY, solve_colors
from gsedit.formats.flags import write_flags
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from rasterizer.color_weights import color_weights
from rasterizer.harmonics import basis
from rasterizer.numerics import SH_DC
from rasterizer.project import view_directions
from rasterizer.render import render
from rasterizer.scene import Gaussians

HEAD = ("scene", "command", "outcome", "s", "said")
SIZE, VIEWS = 24, 3
"""Pixels and number of the views of a solve: columns of its matrix are rendered one by one."""


def crowd(count: int, degree: int = 0) -> Gaussians:
    """Gaussians on the demo's bear."""
    scene = surface_gaussians(demo_scene(), count, torch.Generator().manual_seed(0))
    sh = torch.zeros(len(scene), (degree + 1) ** 2, 3)
    sh[:, 0] = scene.sh[:, 0]
    return replace(scene, sh=sh)


def with_opacity(scene: Gaussians, logit: float) -> Gaussians:
    return replace(scene, logit_opacities=torch.full_like(scene.logit_opacities, logit))


def stretched(scene: Gaussians, along: float, across: float) -> Gaussians:
    """The first axis of each Gaussian times `along`, the last times `across`."""
    factor = torch.tensor([along, 1.0, across]).log()
    return replace(scene, log_scales=scene.log_scales + factor)


def alike(scene: Gaussians, count: int) -> Gaussians:
    """Its first row, again and again."""
    rows = torch.zeros(count, dtype=torch.long)
    return Gaussians(**{name: value[rows] for name, value in vars(scene).items()})


def walled(scene: Gaussians) -> Gaussians:
    """The scene inside a thick shell of opaque Gaussians: no camera sees it."""
    turns = torch.linspace(0, 40 * math.pi, 900)
    up = torch.linspace(-1, 1, 900)
    around = (1 - up**2).sqrt()
    shell = 1.3 * torch.stack((around * turns.cos(), around * turns.sin(), up), -1)
    rows = alike(scene, 900)
    rows = replace(
        rows,
        means=shell + scene.means.mean(0),
        log_scales=torch.full_like(rows.log_scales, math.log(0.15)),
        logit_opacities=torch.full_like(rows.logit_opacities, 12.0),
    )
    values = {name: torch.cat((value, vars(rows)[name])) for name, value in vars(scene).items()}
    return Gaussians(**values)


def plane(count: int = 30) -> Gaussians:
    """A flat square of discs."""
    scene = stretched(alike(crowd(1), count * count), 1.0, 1e-3)
    steps = torch.linspace(-0.5, 0.5, count)
    x, y = torch.meshgrid(steps, steps, indexing="ij")
    means = torch.stack((x, y, torch.zeros_like(x)), -1).reshape(-1, 3)
    flat = torch.tensor([1.0, 0, 0, 0]).expand(count * count, 4)
    sizes = torch.tensor([0.03, 0.03, 1e-5]).log().expand(count * count, 3)
    return replace(scene, means=means, quats=flat.clone(), log_scales=sizes.clone())


def ill(scene: Gaussians) -> Gaussians:
    """Opacities from 1e-6 to 1: the squares of columns differ by 1e12, their norms by 1e6."""
    opacities = torch.logspace(-6, -0.01, len(scene))
    return replace(scene, logit_opacities=torch.logit(opacities.double()).float())


# ---- the solve against float64 ------------------------------------------------------------------

SOLVES: dict[str, tuple[str, Callable[[], Gaussians]]] = {
    "ordinary": ("40 Gaussians, what the others compare to", lambda: crowd(40)),
    "degree 1": ("20 Gaussians whose color depends on the view", lambda: crowd(20, 1)),
    "one": ("1 Gaussian", lambda: crowd(1)),
    "equal rows": ("40 times the same row: the matrix has rank 1", lambda: alike(crowd(1), 40)),
    "opacity 0": ("logit -50: nothing to see", lambda: with_opacity(crowd(40), -50.0)),
    "opacity 1": ("logit 50", lambda: with_opacity(crowd(40), 50.0)),
    "condition 1e6": ("9 times the same row", lambda: alike(crowd(1), 9)),
    "faint": ("opacities from 1e-6 to 1: less than 1/255 is not drawn", lambda: ill(crowd(40))),
    "needles": ("100 : 1 : 0.01", lambda: stretched(crowd(40), 10.0, 0.1)),
    "specks": ("a millionth of the size", lambda: stretched(crowd(40), 1e-6, 1e-6)),
}


def views_of(scene: Gaussians) -> list[View]:
    """Targets: red and blue exchanged, and a square of noise that no colors explain."""
    names = [str(i) for i in range(VIEWS)]
    views = capture(scene, ring_cameras(demo_scene(), VIEWS, SIZE), names)
    noise = torch.Generator().manual_seed(1)
    targets = []
    for view in views:
        image = view.image.flip(-1).clone()
        image[:6, :6] = torch.rand(6, 6, 3, generator=noise)
        targets.append(replace(view, image=image))
    return targets


def matrix_of(scene: Gaussians, targets: list[View]) -> Float[Tensor, "p nk"]:
    """Change of the stacked pixels by each color coefficient (times SH_DC), in float64."""
    blocks = []
    for view in targets:
        weights = color_weights(scene, view.camera)
        columns = torch.eye(len(scene), dtype=torch.float64)
        pictures = [weights.picture(row[:, None].expand(-1, 3))[..., 0] for row in columns]
        turned = basis(view_directions(scene.means, view.camera), isqrt(scene.sh.shape[1]) - 1)
        block = torch.stack(pictures).flatten(1).T[:, :, None] * (turned / SH_DC)
        blocks.append(block.flatten(1))
    return torch.cat(blocks)


def solve_row(name: str) -> list[str]:
    """Cells of a scene: the default solve and a long one against the exact minimum."""
    why, make = SOLVES[name]
    scene = make()
    targets = views_of(scene)
    wide = Gaussians(**{field: value.double() for field, value in vars(scene).items()})
    matrix = matrix_of(wide, targets)
    now = [render(wide, view.camera).color for view in targets]
    missing = torch.stack([v.image.double() - n for v, n in zip(targets, now)]).reshape(-1, 3)
    inside = torch.ones(len(scene), dtype=torch.bool)
    stiff = {"penalty": 1e12, "band_penalty": 1e12, "most_iterations": 1}
    k = scene.sh.shape[1]
    prior = torch.tensor([PENALTY, *[BAND_PENALTY] * (k - 1)]).double().repeat(len(scene))[:, None]
    solves: tuple[dict[str, Any], ...] = ({}, {"most_iterations": 200, "least_gain_db": -99}, stiff)
    began = time.perf_counter()
    short, long, started = (list(solve_colors(scene, targets, inside, **each)) for each in solves)
    seconds = (time.perf_counter() - began) / max(1, len(short) + len(long) + len(started))
    unmoved = torch.zeros(scene.sh[:, :4].shape)  # where there is nothing to see
    found = [each[-1].change if each else unmoved for each in (started, short, long)]
    d0 = found[0].double().reshape(-1, 3)
    hessian = matrix.T @ matrix + prior[:, 0].diag()
    best = torch.linalg.solve(hessian, matrix.T @ missing + prior * d0)

    def objective(change: Tensor) -> float:
        change = change.double().reshape(-1, 3)
        misfit = (matrix @ change - missing).square().sum()
        return float(misfit + (prior * (change - d0).square()).sum())

    least, values = objective(best), torch.linalg.svdvals(matrix)
    finite = all(bool(each.isfinite().all()) for each in found)
    excess = [objective(each) / least - 1 for each in found]
    rank = int((values > 1e-12 * values[0]).sum())
    condition = float(values[0] / values[max(0, rank - 1)]) if rank else 0.0
    return [
        f"**{name}**: {why}", "finite" if finite else "NOT FINITE", f"{rank} of {len(values)}",
        f"{condition:.0e}", *(f"{each:.1e}" for each in excess), f"{len(short)}",
        f"{1e3 * seconds:.1f}",
    ]  # fmt: skip


SOLVE_HEAD = ("", "outcome", "rank", "condition", "map alone", "default", "200 iterations",
              "iterations", "ms each")  # fmt: skip


# ---- commands ----------------------------------------------------------------------------------

SCENES: dict[str, Callable[[], Gaussians]] = {
    "one Gaussian": lambda: crowd(1),
    "equal rows": lambda: alike(crowd(1), 300),
    "opacity 0": lambda: with_opacity(crowd(600), -50.0),
    "opacity 1": lambda: with_opacity(crowd(600), 50.0),
    "all hidden": lambda: walled(crowd(300)),
    "needles": lambda: stretched(crowd(600), 30.0, 1e-3),
    "discs": lambda: stretched(crowd(600), 1.0, 1e-5),
    "a plane": plane,
    "opacities from 1e-6 to 1": lambda: ill(crowd(600)),
}
EDITS = {
    "material": "as bronze",
    "marble": "turn it into marble",
    "light": "at night",
    "growth": "let moss grow on it",
    "snow": "a thick layer of snow on it",
    "solve": "bronze --editor closed-form --loss mse",
    "removal of everything": "remove it --region all",
    "removal of one": "remove it --region {folder}/one.npy",
    "removal of nothing": "remove it --region {folder}/none.npy",
    "twice the size": "make it twice the size",
}


TOLD = ("hardly anything changed",)
"""Beginnings of lines that a command which succeeds may print about its scene."""


def commands(folder: Path) -> dict[str, tuple[list[str], Path]]:
    """The words of each command on the scene of a folder, and what it writes."""
    scene, made = str(folder / "scene.ply"), {}
    for name, text in EDITS.items():
        words, _, options = text.partition(" --")
        more = ("--" + options).format(folder=folder).split() if options else []
        more += [] if "--region" in more else ["--region", "all"] if "remove" not in words else []
        out = folder / name.replace(" ", "_")
        more += ["--size", "64", "-o", str(out)]
        made[name] = (["edit", scene, words, *more], out / "scene.ply")
    means = gsedit.load(scene).means
    ends = (means[means[:, 0].argmax()], means[means[:, 0].argmin()])
    one, other = (",".join(f"{x:.4f}" for x in end.tolist()) for end in ends)
    bend = ["--handle", f"{one}:0.1,0,0", "--hold", other, "-o", str(folder / "bent.ply")]
    made["bending"] = (["bend", scene, *bend], folder / "bent.ply")
    made["mesh"] = (["mesh", scene, "-o", str(folder / "mesh.ply")], folder / "mesh.ply")
    solid = ["--watertight", "-o", str(folder / "solid.stl")]
    made["watertight mesh"] = (["mesh", scene, *solid], folder / "solid.stl")
    return made


def command_row(scene: str, name: str, words: list[str], out: Path) -> list[str]:
    """Run a command here: how it ended, whether what it wrote is finite, seconds, its last line."""
    said, printed = io.StringIO(), io.StringIO()
    began = time.perf_counter()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(printed):
        try:
            importlib.import_module("gsedit_cli.main").app([*words, "-f"])
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    seconds = time.perf_counter() - began
    lines = [line for line in said.getvalue().splitlines() if line.strip()]
    told = next((line for line in reversed(lines) if line.startswith("gsedit: ")), "")
    if code not in (2, 3):
        told = next((line for line in lines if line.startswith(TOLD)), told) or lines[-1] * code
    outcome = "refused" if code in (2, 3) else f"FAILED ({code})" if code else _finite(out)
    told = told.removeprefix("gsedit: ").replace(f"{Path(words[1]).parent}/", "")
    return [scene, name, outcome, f"{seconds:.1f}", told]


def _finite(out: Path) -> str:
    """finite, or what is wrong with a result."""
    if out.suffix == ".stl" or out.name == "mesh.ply":
        import trimesh

        mesh = trimesh.load_mesh(out)
        good = bool(np.isfinite(mesh.vertices).all())
        solid = ", closed" if mesh.is_watertight else ""
        return f"finite, {len(mesh.faces):,} faces{solid}" if good else "NOT FINITE"
    scene = gsedit.load(out)  # which refuses what is not finite
    return f"finite, {len(scene.means):,} Gaussians"


def main(out: Path, chosen: str = "") -> None:
    """Measure all, or rows whose scene or command holds a text; print and write degenerate.md
    and degenerate.csv."""
    out.mkdir(parents=True, exist_ok=True)
    solves = [solve_row(name) for name in SOLVES if chosen in f"solve {name}"]
    rows = []
    for scene, make in SCENES.items():
        folder = out / scene.replace(" ", "_")
        folder.mkdir(exist_ok=True)
        made = make()
        gsedit.save(made, folder / "scene.ply", overwrite=True)
        names = [f"{i}" for i in range(8)]
        views = capture(made, ring_cameras(demo_scene(), 8, 96), names)
        write_cameras(views, folder / "cameras.json", overwrite=True)
        one = np.arange(len(made.means)) == 0
        write_flags(one, folder / "one.npy", overwrite=True)
        write_flags(one & False, folder / "none.npy", overwrite=True)
        for name, (words, result) in commands(folder).items():
            if chosen in f"{scene}: {name}":
                rows.append(command_row(scene, name, words, result))
                print(rows[-1], flush=True)  # noqa: T201
    with (out / "degenerate.csv").open("w") as file:
        csv.writer(file, lineterminator="\n").writerows([HEAD, *rows])
    write_text(out / "degenerate.md", (text := tables(solves, rows)) + "\n")
    print(text)  # noqa: T201


def tables(solves: list[list[str]], rows: list[list[str]]) -> str:
    """The solves; seconds of each command on each scene, in brackets where it was refused; and the
    refusals."""
    names = list(dict.fromkeys(row[1] for row in rows))
    ended = {(row[0], row[1]): row for row in rows}
    lines = []
    for scene in dict.fromkeys(row[0] for row in rows):
        own = [ended[scene, name] for name in names]
        cells = {"finite": "{}", "refused": "({})"}
        shown = (cells.get(r[2].split(",")[0], f"**{r[2]}**").format(r[3]) for r in own)
        lines.append([scene, *shown])
    said = {}
    for row in rows:
        if row[2] == "refused":
            said.setdefault(row[1], f"- {row[1]}, as of {row[0]}: {row[4]}")
    parts = (markdown_table(SOLVE_HEAD, solves), markdown_table(["", *names], lines))
    return "\n\n".join((*parts, "\n".join(said.values())))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:3])
