"""The scenes of the paper's experiments, as Gaussians and views."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import torch

from gsedit.bench.synthetic import demo_scene, ring_cameras, scenes, surface_gaussians
from gsedit.errors import InputError
from gsedit.views.dataset import Dataset, capture
from rasterizer.scene import Gaussians
from research.paper.runs import Case

PROMPTS = {
    "globe": "make it sunset",
    "teddy": "as a bronze statue",
    "columns": "make it autumn",
    "links": "as a jade statue",
    "cage": "make it night",
}
"""Prompts of the synthetic scenes, the first ones first."""
CAPTURE_PROMPT = "turn it into a bronze statue"
PATCHES, PATCH = 2, 64
"""Crops a fitting step renders, and their pixels a side; Instruct-NeRF2NeRF has twice the rays."""


def synthetic(name: str, pixels: int, gaussians: int, views: int) -> Case:
    """A synthetic scene with its prompt."""
    patch = min(PATCH, pixels // 2)
    return Case(name, PROMPTS[name], pixels, PATCHES, patch, gaussians, views)


def captured(scene: Path, data: Path | None, pixels: int) -> Case:
    """A fitted capture, as the bear."""
    patch, photos = min(PATCH, pixels // 2), str(data or "")
    return Case(scene.stem, CAPTURE_PROMPT, pixels, PATCHES, patch, scene=str(scene), data=photos)


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
    from gsedit.formats.scenes import load
    from gsedit.views.around import around
    from gsedit.views.load import load_dataset

    gaussians = load(Path(case.scene)).detach()
    if case.data:
        return gaussians, load_dataset(Path(case.data), size=case.size)
    return gaussians, around(gaussians, case.size)
