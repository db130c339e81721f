"""How well `--region auto` finds a subject that is known exactly, in scenes of several seeds."""

from __future__ import annotations

import sys

import torch

from gsedit.cameras.orbit import circle
from gsedit.datasets.dataset import Dataset, capture
from gsedit.editing.session.choose_region import find_region
from gsedit.regions.lift import lift
from research.labelled import Labelled, demo_bear, statue

VIEWS, SIZE = 16, 128


def found(labelled: Labelled, distance: float) -> tuple[float, float, float]:
    """(IoU, recall, precision) of the subject, each Gaussian counted by what the views see of it.

    The cameras stand around a ball whose radius is `distance`, and which fills the pictures.
    """
    middle = torch.tensor([0.0, 0.0, -0.1], dtype=torch.float64)
    up = labelled.scene.up
    cameras = circle(middle, distance, up, VIEWS, SIZE, elevation=22.0, fov=45.0)
    views = capture(labelled.gaussians, cameras, [str(i) for i in range(VIEWS)])
    region = find_region(
        labelled.gaussians, "auto", dataset=Dataset(views), prompt="turn it into bronze"
    )
    ones = [torch.ones(SIZE, SIZE)] * VIEWS
    weight = lift(labelled.gaussians, cameras, ones).weight
    both = float(weight[region.inside & labelled.subject].sum())
    predicted, true = float(weight[region.inside].sum()), float(weight[labelled.subject].sum())
    return both / (predicted + true - both), both / true, both / predicted


def run(seeds: int, count: int = 12_000) -> None:
    """Print a line a scene."""
    scenes = {"demo": (demo_bear(count), 1.0)}
    scenes |= {f"statue {seed}": (statue(seed, count), 0.62) for seed in range(seeds)}
    for name, (labelled, distance) in scenes.items():
        iou, recall, precision = found(labelled, distance)
        print(f"{name:<10} IoU {iou:.3f}  recall {recall:.3f}  precision {precision:.3f}")  # noqa: T201


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
