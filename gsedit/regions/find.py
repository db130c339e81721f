"""Find the Gaussians that a region names, before any view is edited. `v` views, `n` Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import View, evenly_spaced
from gsedit.errors import UsageError
from gsedit.regions.lift import lift, within_silhouette
from gsedit.regions.masks import read_masks
from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region
from gsedit.regions.region import Region, everything, read_flags
from gsedit.regions.subject import find_drawn, find_subject
from gsedit.scene.merging.groups import MergedScene
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import render
from rasterizer.scene import Gaussians

PREDICTED_SIZE_PIXELS = 128
"""Longer side of the pictures in which the subject is predicted. On the bear, `small` then finds it
better than in pictures of 192 (see docs/concepts/regions.md), in a quarter of the time."""
MAX_PREDICTED_VIEWS = 32
"""Most pictures in which the subject is predicted, evenly spaced."""

ALONE_SHARE = 0.75
"""Least share of all that is seen which the subject of a scene without surroundings fills: what is
left are its parts that were not recognised, as shoes and the feet of a stand."""
EMPTY = 0.1
"""Largest mean opacity of the borders of pictures where an object has nothing around it."""

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

    Masks may be drawn on any view. Where `scene` holds the groups of a large scene, `coarse` maps
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
            drawn = find_drawn(scene, lift(scene, cameras, list(masks.values()), execution))
            inside = within_silhouette(scene, cameras, drawn, execution)
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
    renders = [render(scene, camera, median_depth=True, execution=execution) for camera in cameras]
    probability = predict(torch.stack([each.color.clamp(0, 1) for each in renders]))
    if probability is None:
        return Region(everything(scene).inside, "auto: the instruction is about the whole scene")
    lifted = lift(scene, cameras, list(probability), execution)
    inside = find_subject(scene, lifted)
    if inside is None:
        return Region(everything(scene).inside, "auto: no subject stands out, so it is all")
    share = float(lifted.weight[inside].sum() / lifted.weight.sum().clamp_min(1e-9))
    if share > ALONE_SHARE and border_opacity([each.alpha for each in renders]) < EMPTY:
        return Region(everything(scene).inside, "auto: the subject, with nothing around it")
    return Region(within_silhouette(scene, cameras, inside, execution), "auto: the subject")


def border_opacity(alphas: Sequence[Float[Tensor, "h w"]]) -> float:
    """The mean opacity along the borders of pictures: near 0 for an object on nothing."""
    sides = [side for a in alphas for side in (a[0], a[-1], a[:, 0], a[:, -1])]
    return float(torch.cat(sides).mean())


def _small_camera(camera: Camera) -> Camera:
    """The camera on a picture whose longer side is PREDICTED_SIZE_PIXELS."""
    scale = PREDICTED_SIZE_PIXELS / max(camera.width, camera.height)
    return camera.resized(*(max(1, round(scale * side)) for side in (camera.width, camera.height)))
