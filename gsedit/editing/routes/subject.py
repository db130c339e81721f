"""The part of a scene that routes change: its subject, or what a region names."""

from __future__ import annotations

from collections.abc import Sequence

from gsedit.datasets.viewpoints import Viewpoint
from gsedit.regions.region import Region
from gsedit.selecting.find import named_region
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


def find_part(
    scene: Gaussians,
    viewpoints: Sequence[Viewpoint],
    region: str = "auto",
    execution: Execution = AUTO,
) -> Region:
    """Find the Gaussians that a region (see gsedit.regions.parse) names; auto: the main subject.

    Raises UsageError for an empty region, InputError for a file that does not fit.
    """
    found = named_region(region, scene.detach(), viewpoints, (), execution)
    assert found is not None  # None only where nobody knows whether all is meant
    return found
