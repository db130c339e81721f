"""Find the Gaussians that a region names, before any view is edited. `n` Gaussians."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from gsedit.datasets.dataset import View
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.errors import UsageError
from gsedit.regions.drawn import find_drawn
from gsedit.regions.lift import lift, within_silhouette
from gsedit.regions.masks import read_masks
from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region
from gsedit.regions.region import Region, everything, read_flags
from gsedit.scene.merging.groups import MergedScene
from gsedit.selecting.subject import find_subject
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


def named_region(
    text: str,
    scene: Gaussians,
    views: Sequence[View | Viewpoint],
    held_out: Sequence[View | Viewpoint],
    execution: Execution,
    *,
    coarse: MergedScene | None = None,
    whole: bool | None = False,
) -> Region | None:
    """The region that `text` (see gsedit.regions.parse) names.

    `whole` says whether an instruction is about the whole scene: then `auto` is everything; where
    that is not known (None), it is None, and else the subject.

    Masks may be drawn on any view. Where `scene` holds the groups of a large scene, `coarse` maps
    between both. Raises UsageError for an empty region, InputError for a file that does not fit.
    """
    match spec := parse_region(text):
        case All():
            return everything(scene)
        case Auto():
            if whole is None:
                return None
            if whole:
                note = "auto: the instruction is about the whole scene"
                return Region(everything(scene).inside, note)
            return find_subject(scene, [view.camera for view in views], execution)
        case Box() | Sphere():
            inside = torch.from_numpy(spec.contains(scene.means.detach().numpy()))
        case File(path) if path.suffix.lower() == ".npy":
            inside = read_flags(path, len(scene if coarse is None else coarse.fine))
            inside = inside if coarse is None else coarse.majority(inside)
        case File(path):
            every = (*views, *held_out)
            masks = read_masks(path, every)
            cameras = [every[i].camera for i in masks]
            drawn = find_drawn(scene, lift(scene, cameras, list(masks.values()), execution))
            inside = within_silhouette(scene, cameras, drawn, execution)
    if not inside.any():
        raise _empty(text, scene)
    return Region(inside, text)


def _empty(text: str, scene: Gaussians) -> UsageError:
    """The error for a region that holds nothing."""
    low, high = (
        ", ".join(f"{x:.4g}" for x in corner.tolist())
        for corner in (scene.means.amin(0), scene.means.amax(0))
    )
    return UsageError(
        f"region {text} holds no Gaussian of the scene, whose centers are from ({low}) to "
        f"({high}): look at it with gsedit render SCENE --region ..."
    )


def known_region(text: str, scene: Gaussians) -> Region:
    """The region that `text` names, to measure with: all, box:..., sphere:... or a .npy.

    Raises UsageError for another text or an empty region, InputError for a file that does not fit.
    """
    spec = parse_region(text)
    is_mask = isinstance(spec, File) and spec.path.suffix.lower() != ".npy"
    region = None if is_mask else named_region(text, scene, (), (), AUTO, whole=None)
    if region is None:
        raise UsageError(
            f"region {text} depends on an editor or on photos, and a region to measure with "
            "must be known: give the region.npy that gsedit edit wrote, a box or a sphere"
        )
    return region
