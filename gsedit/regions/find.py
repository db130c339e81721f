"""Find the Gaussians that a region names, before any view is edited. `v` views, `n` Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import View, evenly_spaced
from gsedit.errors import UsageError
from gsedit.regions.lift import lift
from gsedit.regions.masks import read_masks
from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region
from gsedit.regions.region import Region, everything, read_flags
from gsedit.regions.subject import find_drawn, find_subject
from gsedit.scene.merging.cells import MergedScene
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians

PREDICTED_SIZE_PIXELS = 128
"""Longer side of the pictures in which the subject is predicted. On the bear, `small` then finds it
better than in pictures of 192 (see docs/concepts/regions.md), in a quarter of the time."""
MAX_PREDICTED_VIEWS = 32
"""Most pictures in which the subject is predicted, evenly spaced."""

PredictSubject = Callable[[Float[Tensor, "v h w 3"]], Float[Tensor, "v h w"] | None]
"""A map from unedited pictures to the probability that a pixel shows what an instruction is about;
None where that is the whole picture."""


def named_region(
    text: str,
    scene: Gaussians,
    views: Sequence[View],
    held_out: Sequence[View],
    execution: Execution,
    *,
    coarse: MergedScene | None = None,
    predict: PredictSubject | None = None,
) -> Region | None:
    """The region that `text` (see gsedit.regions.parse) names; None for `auto` without `predict`.

    Masks may be drawn on any view. Where `scene` holds the cells of a large scene, `coarse` maps
    between both. Raises UsageError for an empty region, InputError for a file that does not fit.
    """
    match spec := parse_region(text):
        case All():
            return everything(scene)
        case Auto():
            return None if predict is None else _predicted(scene, views, predict, execution)
        case Box() | Sphere():
            inside = torch.from_numpy(spec.contains(scene.means.detach().numpy()))
        case File(path) if path.suffix.lower() == ".npy":
            inside = read_flags(path, len(scene if coarse is None else coarse.fine))
            inside = inside if coarse is None else coarse.majority(inside)
        case File(path):
            every = (*views, *held_out)
            masks = read_masks(path, every)
            cameras = [every[i].camera for i in masks]
            inside = find_drawn(scene, lift(scene, cameras, list(masks.values()), execution))
    if not inside.any():
        low, high = (
            ", ".join(f"{x:.4g}" for x in corner.tolist())
            for corner in (scene.means.amin(0), scene.means.amax(0))
        )
        raise UsageError(
            f"region {text} holds no Gaussian of the scene, whose centers are from ({low}) to "
            f"({high}): look at it with gsedit render SCENE --region ..."
        )
    return Region(inside, text)


def known_region(text: str, scene: Gaussians) -> Region:
    """The region that `text` names, to measure with: all, box:..., sphere:... or a .npy.

    Raises UsageError for another text or an empty region, InputError for a file that does not fit.
    """
    spec = parse_region(text)
    is_mask = isinstance(spec, File) and spec.path.suffix.lower() != ".npy"
    region = None if is_mask else named_region(text, scene, (), (), AUTO)
    if region is None:
        raise UsageError(
            f"region {text} depends on an editor or on photos, and a region to measure with "
            "must be known: give the region.npy that gsedit edit wrote, a box or a sphere"
        )
    return region


@torch.no_grad()
def _predicted(
    scene: Gaussians, views: Sequence[View], predict: PredictSubject, execution: Execution
) -> Region:
    """The subject as `predict` sees it in small renders of the views."""
    chosen = evenly_spaced(len(views), MAX_PREDICTED_VIEWS)
    cameras = [_small_camera(views[i].camera) for i in chosen]
    # with median depth, as every other render of the unedited scene: equal to the last bit
    pictures = [
        render(scene, camera, median_depth=True, execution=execution).color.clamp(0, 1)
        for camera in cameras
    ]
    probability = predict(torch.stack(pictures))
    if probability is None:
        return Region(everything(scene).inside, "auto: the instruction is about the whole scene")
    inside = find_subject(scene, lift(scene, cameras, list(probability), execution))
    if inside is None:
        return Region(everything(scene).inside, "auto: no subject stands out, so it is all")
    return Region(inside, "auto: the subject")


def _small_camera(camera: Camera) -> Camera:
    """The camera on a picture whose longer side is PREDICTED_SIZE_PIXELS."""
    scale = PREDICTED_SIZE_PIXELS / max(camera.width, camera.height)
    return camera.resized(*(max(1, round(scale * side)) for side in (camera.width, camera.height)))
