"""The scenes of the paper's experiments, as Gaussians and views."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import torch

from gsedit.datasets.dataset import Dataset, capture
from gsedit.errors import InputError
from gsedit.synthetic import demo_scene, ring_cameras, scenes, surface_gaussians
from rasterizer.scene import Gaussians
from research.paper.runs import Case

PROMPTS = {
    "globe": "make it sunset",
    "teddy": "as a bronze statue",
    "columns": "make it autumn",
    "links": "as a jade statue",
    "cage": "make it night",
}
"""Prompts of the synthetic scenes that are measured, the first ones first."""
TUNING = ("pond", "as a golden statue")
"""The scene, and its instruction, on which strategies are tuned; it is measured nowhere else."""
CAPTURE_PROMPT = "turn the bear into a bronze statue"


@cache
def load_case(case: Case) -> tuple[Gaussians, Dataset]:
    """The unedited scene and its views. Raises InputError."""
    if case.scene:
        return _capture(case)
    solids = {"teddy": demo_scene()} | {scene.name: scene for scene in scenes()}
    if case.name not in solids:
        raise InputError(f"there is no synthetic scene {case.name!r}: {', '.join(solids)}")
    solid = solids[case.name]
    gaussians = surface_gaussians(solid, case.gaussians, torch.Generator().manual_seed(0))
    cameras = ring_cameras(solid, case.views, case.size)
    names = [f"{case.name}_{i:03d}" for i in range(case.views)]
    return gaussians, Dataset(capture(gaussians, cameras, names))


def _capture(case: Case) -> tuple[Gaussians, Dataset]:
    from gsedit.cameras.around import around
    from gsedit.datasets.load import load_dataset
    from gsedit.formats.scenes import load

    gaussians = load(Path(case.scene)).detach()
    if case.data:
        return gaussians, load_dataset(Path(case.data), size=case.size)
    return gaussians, around(gaussians, case.size)
