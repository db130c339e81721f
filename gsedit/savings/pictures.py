"""Pictures and parts of pictures that an edit does not need."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.depth_maps import Visibility
from gsedit.savings.decision import Bound, Decision, LeftOut
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT
from rasterizer.project import project
from rasterizer.scene import Gaussians

RESOLVED = 2.0
"""Standard deviation, pixels, of a splat that half as many pixels a side still resolve: of a
Gaussian of 1 pixel, 0.7 % lies beyond the frequencies that pixels can hold, exp(-pi^2 / 2)."""
LOST = 1 / 255
"""RMSE that a smaller size may cost: one step of an 8-bit picture, 48 dB. It takes 0.1 dB from an
edit that is 32 dB from its goal."""
APART = 0.01
"""Overlap of two views (see `view_overlap`) below which their cells are not compared."""


def decide_views(edited: int, budget: int, coverage: float, wanted: float) -> Decision:
    """Of the views of `budget` that are not edited, since the `edited` ones cover enough.

    A Gaussian that is not covered may keep any colour. Together these carry 1 - coverage of all
    blending weights of all views, and so of all pixels.
    """
    if edited == budget:
        reason = f"{edited} views cover {coverage:.0%}, {wanted:.0%} are wanted"
        return Decision("views", False, f"Needed: {reason}")
    return Decision(
        "views",
        True,
        f"{edited} views show well {coverage:.1%} of what all show",
        (LeftOut(budget - edited, budget, "views that may be edited"),),
        1 - edited / budget,
        "the editing and the update",
        Bound(1 - coverage, "of a pixel's colour, mean over the pixels of all views"),
    )


def footprint(scene: Gaussians, camera: Camera, weights: Float[Tensor, " n"]) -> float:
    """Median standard deviation, pixels, of what a camera sees: along each splat's shorter axis on
    the picture, a splat counting by its `weights` (its share of the picture)."""
    rows = (weights > 0).nonzero().squeeze(1)
    if not len(rows):
        return 0.0
    xx, xy, yy, _ = project(scene[rows], camera, DEFAULT).covariance.unbind(-1)
    shorter = (xx + yy) / 2 - (((xx - yy) / 2).square() + xy.square()).sqrt()
    order = shorter.argsort()
    total = weights[rows][order].double().cumsum(0)
    middle = int((total < total[-1] / 2).sum())
    return float(shorter[order[middle]].clamp_min(0).sqrt())


def enlarged(picture: Float[Tensor, "y x 3"], width: int, height: int) -> Float[Tensor, "h w 3"]:
    """The picture interpolated to that size."""
    stack = picture.movedim(-1, 0)[None]
    larger = F.interpolate(stack, (height, width), mode="bicubic", align_corners=False)
    return larger[0].movedim(0, -1).clamp(0, 1)


def lost(large: Sequence[Float[Tensor, "h w 3"]], small: Sequence[Float[Tensor, "y x 3"]]) -> float:
    """The largest RMSE between pictures and their small versions, enlarged."""
    errors = [
        (enlarged(b.clamp(0, 1), a.shape[1], a.shape[0]) - a.clamp(0, 1)).square().mean().sqrt()
        for a, b in zip(large, small, strict=True)
    ]
    return float(torch.stack(errors).max())


def decide_resolution(
    full: tuple[int, int], drawn: tuple[int, int], footprint: float, error: float
) -> Decision:
    """Of pictures of `drawn` pixels instead of `full`. `footprint` is of the splats at full size,
    `error` what the smaller pictures of the unedited scene lack (or would)."""
    size = "{}x{}".format(*full)
    if drawn == full:
        if footprint < RESOLVED:
            reason = f"the median splat of {footprint:.1f} pixels needs {size} pixels"
        elif error:
            reason = f"half of {size} pixels would change the unedited views by {error:.2g} RMSE"
        else:
            reason = f"{size} pixels is what the editor edits best"
        return Decision("resolution", False, f"Needed: {reason}")
    share = drawn[0] * drawn[1] / (full[0] * full[1])
    return Decision(
        "resolution",
        True,
        f"The median splat is {footprint:.1f} pixels wide at {size}: {drawn[0]}x{drawn[1]} show it",
        (LeftOut(full[0] * full[1] - drawn[0] * drawn[1], full[0] * full[1], "pixels of a view"),),
        1 - share,
        "the pixels drawn",
        Bound(error, "RMSE of an unedited view"),
    )


def decide_pairs(overlap: Float[Tensor, "v v"], rules: Visibility | None) -> Decision:
    """Of pairs of the edited views that are not compared for correspondences, where matches are
    accepted by `rules`.

    A matched cell has an alpha of at least `min_alpha` in both pictures, shows the same surface in
    both, and is at most `footprint` times as wide and high in one as in the other. Its Gaussians so
    count at least min_alpha / footprint^2 of a cell in the overlap, and a pair of less overlap than
    `APART` matches at most APART footprint^2 / min_alpha of its cells.
    """
    if rules is None:
        return Decision("correspondences", False, "Needed: without rules, any pair may match")
    views = len(overlap)
    pairs = views * (views - 1) // 2
    above = torch.ones(views, views, dtype=torch.bool).triu(1)
    apart = int((overlap < APART)[above].sum())
    if not apart:
        least = f"; the least overlap is {float(overlap[above].min()):.2g}" if pairs else ""
        return Decision(
            "correspondences", False, f"Needed: all {pairs} pairs of views overlap{least}"
        )
    return Decision(
        "correspondences",
        True,
        f"They overlap by less than {APART:.0%}",
        (LeftOut(apart, pairs, "pairs of edited views"),),
        apart / pairs,
        "the matching of cells",
        Bound(APART * rules.footprint**2 / rules.min_alpha, "of the cells of a pair"),
    )


def decide_crops(known: bool, touching: float, patches: int, needed: int) -> Decision:
    """Of crops of the update in which the region, if it is `known`, does not show.

    `touching` is the share of those in which it does; `needed` of `patches` crops a step are as
    many as show it on average, rounded up.

    Where the region is less than 1 / 255 of a pixel, no colour of it changes the pixel by more.
    """
    if not known:
        return Decision("crops", False, "The region is known once views are edited: decided then")
    if touching >= 1:
        return Decision("crops", False, "Needed: what may change shows in every crop")
    more = "" if needed < patches else "; a step still draws as many, all of them useful"
    return Decision(
        "crops",
        True,
        f"The region shows in {touching:.0%} of all crops: only these are drawn{more}",
        (LeftOut(patches - needed, patches, "crops a step"),) if needed < patches else (),
        1 - needed / patches,
        "the crops of the update",
        Bound(1 / 255, "of the colour of a pixel in the other crops"),
    )


def decide_depth() -> Decision:
    """Of depth where nobody reads it."""
    return Decision(
        "depth",
        True,
        "Only views that are edited or compared need depth: crops of the update and the pictures "
        "that are measured are drawn without",
        saving=1 / 4,
        saves="the channels blended in the update",
        bound=Bound(0.0, ""),
    )
