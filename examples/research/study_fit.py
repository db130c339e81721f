"""Worth of each choice of the fit's recipe: the recipe, and the recipe with one choice undone.

The held-out photos of the capture, which measure results elsewhere, are left out altogether: every
8th of the others, counted from the 4th, is held out instead. One line of JSON a run: mean PSNR of
those and of some that were trained on, dB; steps, Gaussians, CPU seconds.

python -m research.study_fit OUT.jsonl photos/ [--size 128] [--steps 1000] [--seeds 0 1]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

import gsedit
from gsedit.datasets.dataset import Dataset
from gsedit.fitting.fit import FitResult, evaluate, fit_steps
from gsedit.fitting.settings import FitSettings

FULL = 256
"""Pixels on the longer side at which all sparse points and the numbers of ARMS belong together: at
half the size, a quarter of them."""
ARMS: dict[str, dict[str, Any]] = {
    "the recipe": {},
    "sparse points only": {"dense_start": 0},
    "no growth": {"densify_until": 0.0},
    "full size from the first step": {"coarse": ()},
    "opacities are not lowered": {"opacity_decay": 0.0},
    "SH degree 0": {"sh_degree": 0},
    "SH degree 2": {"sh_degree": 2},
    "L1 alone": {"dssim_weight": 0.0},
}


def main() -> None:
    """Append the runs to OUT.jsonl."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    options = parser.parse_args()
    torch.set_num_threads(1)
    share = (options.size / FULL) ** 2
    data = development(gsedit.load_dataset(options.photos, size=options.size), share)
    with options.out.open("a") as lines:
        for row in study(data, options.steps, options.seeds, share):
            print(json.dumps(row), file=lines, flush=True)
            sys.stdout.write(f"{row}\n")


def study(
    data: Dataset,
    steps: int,
    seeds: list[int],
    share: float,
    arms: Mapping[str, dict[str, Any]] = ARMS,
) -> Iterator[dict[str, Any]]:
    """Every arm with every seed; `share` of the Gaussians that the defaults have."""
    whole = FitSettings(steps=steps, seconds=None, checkpoint_seconds=1e9, evaluations=2)
    few = replace(
        whole,
        dense_start=round(share * whole.dense_start),
        max_gaussians=round(share * whole.max_gaussians),
    )
    for name, switch in arms.items():
        for seed in seeds:
            began = time.process_time()
            generator = torch.Generator().manual_seed(seed)
            *_, result = fit_steps(data, replace(few, **switch), generator=generator)
            assert isinstance(result, FitResult)
            yield {
                "arm": name,
                "seed": seed,
                "held_out": round(result.psnr, 3),
                "trained_on": round(evaluate(result.scene, data.split()[0][::8]), 3),
                "steps": result.steps,
                "gaussians": len(result.scene),
                "cpu_seconds": round(time.process_time() - began, 1),
            }


def development(data: Dataset, share: float) -> Dataset:
    """The training photos in an order whose every 8th starts at the 4th; `share` of the points."""
    train, _ = data.split()
    data = replace(data, views=train[3:] + train[:3])
    points, colors = data.points, data.point_colors
    if points is None or share >= 1:
        return data
    chosen = torch.randperm(len(points), generator=torch.Generator().manual_seed(9))
    chosen = chosen[: round(share * len(points))]
    return replace(
        data, points=points[chosen], point_colors=None if colors is None else colors[chosen]
    )


if __name__ == "__main__":
    main()
