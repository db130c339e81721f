"""Regions that are known without a 2D editor: everything, a box, a sphere, or flags in a file."""

from __future__ import annotations

from gsedit.errors import UsageError
from gsedit.regions.parse import All, Box, File, Sphere, parse_region
from gsedit.regions.region import Region, everything, read_flags
from rasterizer.scene import Gaussians


def known_region(text: str, scene: Gaussians) -> Region:
    """The region that `text` names of a scene, to be measured: all, box:..., sphere:... or a .npy.

    Raises UsageError for another text or an empty region, InputError for a file that does not fit.
    """
    match spec := parse_region(text):
        case All():
            return everything(scene)
        case Box() | Sphere():
            inside = spec.contains(scene.means)
        case File(path) if path.suffix.lower() == ".npy":
            inside = read_flags(path, len(scene))
        case _:
            raise UsageError(
                f"region {text} depends on an editor or on photos, and a region to measure with "
                "must be known: give the region.npy that gsedit edit wrote, a box or a sphere"
            )
    if not inside.any():
        raise UsageError(f"region {text} holds no Gaussian of the scene: name one that does")
    return Region(inside, text)
