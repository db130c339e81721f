"""The part of a scene that routes change: its subject, or what a region names."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import Dataset, View, evenly_spaced
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.editors.small.denoiser import load_small
from gsedit.editors.small.subject import subject_map
from gsedit.regions.find import named_region
from gsedit.regions.region import Region
from gsedit.scene.picture import render_picture
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

SEARCHED_VIEWS = 16
"""Most views in which the subject is searched: on the bear, IoU 0.986 to the subject found in 32,
in two thirds of the time."""


def find_part(
    scene: Gaussians,
    viewpoints: Sequence[Viewpoint],
    region: str = "auto",
    execution: Execution = AUTO,
) -> Region:
    """Find the Gaussians that a region (see gsedit.regions.parse) names; auto: the main subject.

    Raises UsageError for an empty region, InputError for a file that does not fit.
    """
    lazy: Any = [partial(render_picture, scene, each.camera, execution) for each in viewpoints]
    views = tuple(View(v.name, v.camera, image) for v, image in zip(viewpoints, lazy))
    some, held_out = Dataset(views).split()
    some = some or views
    if region == "auto":
        some = tuple(some[i] for i in evenly_spaced(len(some), SEARCHED_VIEWS))
    found = named_region(region, scene, some, held_out, execution, predict=_subject)
    assert found is not None  # None only without a prediction
    return found


def _subject(originals: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
    return subject_map(load_small().network, originals)
