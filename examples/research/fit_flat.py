"""Meshes of fits that press Gaussians flat: `python -m research.fit_flat FOLDER`.

The fit's loss gets weight * mean(least / middle standard deviation); 0 is the fit as it is. Scenes
are kept in a folder, so that a call goes on where the last one stopped.
"""

from __future__ import annotations

from pathlib import Path
from time import monotonic, process_time
from typing import Annotated

import torch
import typer
from torch import Tensor

from gsedit import FitSettings, fit, load, save
from gsedit.fitting import fit as fitting
from gsedit.meshing import mesh
from gsedit.synthetic import demo_scene, scenes, traced_dataset
from research.command import print_result, run
from research.measure_meshes import errors, ring_views, seen_points

CASES = [
    *((name, seed, weight) for name in ("bear", "links", "cage") for seed in (0, 1)
      for weight in (0.0, 0.05, 0.5)),
    *((name, seed, 0.0) for name in ("columns", "pond") for seed in (0, 1)),
]  # fmt: skip
SETTINGS = FitSettings(steps=1500, max_gaussians=30_000)


def flatter(weight: float) -> type:
    """The fit with the term."""

    class Flat(fitting._Fit):
        def _loss(self, scene, view, background) -> Tensor:
            ordered = scene.scales.sort(-1).values
            return (
                super()._loss(scene, view, background)
                + weight * (ordered[:, 0] / ordered[:, 1]).mean()
            )

    return Flat


def main(
    folder: Annotated[Path, typer.Argument(help="Where fitted scenes are kept.")],
    seconds: Annotated[float, typer.Option(help="No case begins after so many.")] = 1e9,
) -> None:
    """Print a row of a Markdown table for each case."""
    begun, plain = monotonic(), fitting._Fit
    gallery = {scene.name: scene for scene in (*scenes(), demo_scene())}
    folder.mkdir(exist_ok=True, parents=True)
    for name, seed, weight in CASES:
        row = folder / f"{name}_{seed}_{weight:g}.txt"
        if not row.exists() and monotonic() - begun < seconds:
            scene, path = gallery[name], row.with_suffix(".ply")
            cameras = ring_views(scene)
            data = traced_dataset(scene, cameras)
            spent = process_time()
            if not path.exists():
                fitting._Fit = flatter(weight) if weight else plain
                made = fit(data, SETTINGS, generator=torch.Generator().manual_seed(seed))
                save(made.scene, path)
            spent, made = process_time() - spent, load(path).detach()
            decibels = fitting.evaluate(made, data.split()[1])
            texts = []
            for watertight in (False, True):
                start = process_time()
                found = mesh(made, cameras, watertight=watertight)
                took = process_time() - start
                chamfer, far, angle = errors(found, scene, seen_points(scene, cameras))
                texts.append(f"{chamfer:.2f} | {far:.2f} | {angle:.1f} | {took:.0f}")
            row.write_text(
                f"| {name} | {seed} | {weight:g} | {decibels:.2f} | {spent:.0f} | "
                + " | ".join(texts)
            )
        if row.exists():
            print_result(row.read_text())


if __name__ == "__main__":
    run(main)
