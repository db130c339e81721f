"""Finished pictures made to agree, for editors that cannot be sampled together.

`v` views of `h w` pixels, `y x` cells, `n` = y x cells in a view, `k` clusters, `m` cells that are
in one. Diffusion editors make views agree while they are sampled (see consensus.py); a program
returns finished pictures, one of which may show another edit than the rest. So the colors of
corresponding cells are brought to a *robust* mean, by a correction without fine detail: matches
are exact to half a cell only, and detail averaged at that precision would be blurred.

`harmonise_by_depth` does so at pixel resolution, for any editor; `k` pictures of one place.
Consensus while sampling reaches the cells that match. More of two pictures shows the same surface
than cells do (a match is mutual, and fills a cell), and the rendered depth of the unedited scene
says where. So the low band of every picture is led towards the robust mean of what the others show
at the same places. Only what the edit added is corrected: captured surfaces look different from
view to view, and a difference as large as that of the unedited pictures at the same place is left.
What is finer than the low band stays each view's own: depth is not exact enough for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.consistency.correspond import Correspondences
from gsedit.views.depth_maps import warp_of
from rasterizer.camera import Camera

TOLERANCE = 0.1
"""Colors that lie this near the agreed one count in full, farther ones less and less: a view's own
tint is averaged, a view with another edit is outvoted. A tenth of the range: between what editors
differ in by chance and what two variants of one edit differ in."""
SMOOTHING = 1.0
"""Cells, standard deviation of the blur of a correction. Measured on a painted scene with exact
depth and cells of a pixel, in RMSE: a true edit is damaged by 0.008 (0.021 without a blur), and one
view of five that was not edited comes from 0.37 to 0.11 of the true edit (0.10 without a blur, 0.18
with one of 2)."""


def harmonise(
    images: Float[Tensor, "v h w 3"],
    matches: Correspondences,
    *,
    anchored: Bool[Tensor, " v"] | None = None,
    strength: float = 1.0,
    tolerance: float = TOLERANCE,
) -> Float[Tensor, "v h w 3"]:
    """The pictures with the mean colors of corresponding cells brought together, in [0, 1].

    Where a cluster has cells of anchored views, those alone decide, and anchored pictures stay as
    they are, as do cells that correspond to nothing (beyond a border of three cells, in which the
    correction fades). `strength` in [0, 1] leads from the pictures to agreement. Raises UsageError
    for cells of other pictures.
    """
    views, height, width = images.shape[:3]
    cell, labels = matches.cell, matches.labels
    grid = (-(-height // cell), -(-width // cell))
    if labels.shape != (views, *grid):
        raise UsageError(
            f"correspondences are for {tuple(labels.shape)} views and cells, the images have "
            f"{(views, *grid)}: match the cells of the images that are edited"
        )
    if not 0 <= strength <= 1:
        raise UsageError(f"strength must be from 0 to 1, not {strength:g}")
    led = torch.zeros(views, dtype=torch.bool) if anchored is None else anchored
    means = cell_means(images, cell)
    difference = _agreed(means, labels, led, tolerance) - means
    correction = _smooth(difference, (labels >= 0) & ~led[:, None, None])
    correction = F.interpolate(
        correction.movedim(-1, 1), scale_factor=float(cell), mode="bilinear", align_corners=False
    ).movedim(1, -1)[:, :height, :width]
    return (images + strength * correction).clamp(0, 1)


def cell_means(images: Float[Tensor, "v h w c"], cell: int) -> Float[Tensor, "v y x c"]:
    """Mean of each cell's pixels; of those that there are, at the right and lower border."""
    sums = F.avg_pool2d(
        images.movedim(-1, 1), cell, ceil_mode=True, count_include_pad=False
    )  # fmt: skip
    return sums.movedim(1, -1)


def robust_mean(
    values: Float[Tensor, "m c"],
    groups: Int[Tensor, " m"],
    count: int,
    weights: Float[Tensor, " m"],
    tolerance: float = TOLERANCE,
) -> Float[Tensor, "k c"]:
    """Location of each group of rows: the sum of weights times the pseudo-Huber distance is least.

    That is the mean for rows within `tolerance` of it, and nears the geometric median (which
    half of the rows, less one, cannot drag away) for rows far beyond. Found by reweighting from the
    mean (Weiszfeld's iteration, smoothed). Groups of one or two rows have their mean.
    """
    weighted = weights[:, None]
    for _ in range(21):  # each moves the mean by less than half of the one before
        total = values.new_zeros(count, 1).index_add(0, groups, weighted)
        sums = values.new_zeros(count, values.shape[1]).index_add(0, groups, values * weighted)
        center = sums / total.clamp_min(torch.finfo(values.dtype).tiny)
        distance = (values - center[groups]).square().sum(-1, keepdim=True)
        weighted = weights[:, None] / (1 + distance / tolerance**2).sqrt()
    return center


def _agreed(
    means: Float[Tensor, "v y x 3"],
    labels: Int[Tensor, "v y x"],
    led: Bool[Tensor, " v"],
    tolerance: float,
) -> Float[Tensor, "v y x 3"]:
    """The color of each cell after agreement: its cluster's, or its own where it is in none."""
    flat = labels.reshape(-1).long()
    rows = torch.nonzero(flat >= 0).squeeze(1)
    if not len(rows):
        return means
    groups, count = flat[rows], int(flat.max()) + 1
    leads = led[rows // labels[0].numel()]
    decided = torch.zeros(count, dtype=torch.bool)
    decided[groups[leads]] = True
    weights = (leads | ~decided[groups]).to(means)
    values = means.reshape(-1, 3)
    center = robust_mean(values[rows], groups, count, weights, tolerance)
    return values.index_copy(0, rows, center[groups]).reshape(means.shape)


def _smooth(
    difference: Float[Tensor, "v y x 3"], member: Bool[Tensor, "v y x"]
) -> Float[Tensor, "v y x 3"]:
    """A correction without fine detail that ends smoothly around the members.

    Each cell takes the Gaussian mean of the members about it; in full where at least half of the
    weight within the picture is theirs, as on a straight border, and less beyond.
    """
    mask = member[:, None].to(difference)
    stacked = torch.cat((difference.movedim(-1, 1) * mask, mask, torch.ones_like(mask)), 1)
    blurred = _blur(stacked, SMOOTHING)
    share, inside = blurred[:, 3:4], blurred[:, 4:]
    full = (2 * share / inside).clamp(max=1)
    return (blurred[:, :3] / share.clamp_min(1e-6) * full).movedim(1, -1)


# ---- at pixel resolution ------------------------------------------------------------------------

BAND = 1 / 128
"""Standard deviation of the blur that leaves the low band, in longer sides of a picture: half of a
cell of 4 pixels at 256."""
SURROUNDINGS_BANDS = (2.0, 8.0)
"""The correction of what corresponds is carried to what does not, in full where half of the
surroundings correspond, and less beyond; widths of these surroundings, in bands."""
EMPTY = 1e-6
"""A blurred mask below it has nothing known near."""


class Surface(NamedTuple):
    """Surface that the unedited scene shows at a view."""

    camera: Camera
    depth: Float[Tensor, "h w"]
    """Median depth along the view."""
    alpha: Float[Tensor, "h w"]
    color: Float[Tensor, "h w 3"]


@torch.no_grad()
def harmonise_by_depth(
    images: Float[Tensor, "v h w 3"],
    surfaces: Sequence[Surface],
    *,
    anchored: Bool[Tensor, " v"] | None = None,
    strength: float = 1.0,
) -> Float[Tensor, "v h w 3"]:
    """The pictures with their low bands led towards agreement, in [0, 1].

    Anchored pictures stay as they are, and where one shows a place it alone decides. `strength` in
    [0, 1] leads from the pictures to agreement. Places that no other picture shows take the
    correction of their surroundings, or none.
    """
    if len(images) < 2:
        return images
    led = [False] * len(images) if anchored is None else anchored.tolist()
    free = [a for a, is_led in enumerate(led) if not is_led]
    others = {a: [b for b in range(len(images)) if b != a] for a in free}
    agreed = images.clone()
    for a in free:
        warps = [warp_of(*surfaces[a][:3], *surfaces[b][:3]) for b in others[a]]
        decides = torch.tensor([led[b] for b in others[a]])
        edited = torch.stack([warp(images[b]) - images[a] for b, warp in zip(others[a], warps)])
        unedited = torch.stack(
            [warp(surfaces[b].color) - surfaces[a].color for b, warp in zip(others[a], warps)]
        )
        valid = torch.stack([warp.valid for warp in warps])
        correction = _correction(edited, unedited.to(edited), valid, decides)
        agreed[a] = (images[a] + strength * correction).clamp(0, 1)
    return agreed


def _correction(
    edited: Float[Tensor, "k h w 3"],
    unedited: Float[Tensor, "k h w 3"],
    valid: Bool[Tensor, "k h w"],
    decides: Bool[Tensor, " k"],
) -> Float[Tensor, "h w 3"]:
    """Correction that moves a picture's low band to the agreed one, from how the others differ from
    it.

    Differences are blurred, not pictures, and each over the surface that it is known on: no color
    crosses a silhouette.
    """
    mask = valid[:, None].to(edited)
    band = BAND * max(edited.shape[1:3])
    weight = _blur(mask, band).clamp_min(EMPTY)
    low, own = (_blur(d.movedim(-1, 1) * mask, band) / weight * mask for d in (edited, unedited))
    excess = low - low.clamp(-own.abs(), own.abs())
    leads = valid & decides[:, None, None]
    is_led = leads.any(0)
    voters = torch.cat((~is_led[None], torch.where(is_led, leads, valid)))[:, None]
    voters[0] |= ~voters.any(0)
    agreed = _robust_mean(torch.cat((torch.zeros_like(low[:1]), excess)), voters)
    return _carried(agreed, mask.amax(0), band).movedim(0, -1)


def _robust_mean(
    values: Float[Tensor, "k c h w"], voters: Bool[Tensor, "k 1 h w"]
) -> Float[Tensor, "c h w"]:
    """Robust mean of the voters (at least one) at each pixel, as `robust_mean`."""
    given = voters.to(values)
    weights, center = given, values[0]
    for _ in range(4):
        center = (weights * values).sum(0) / weights.sum(0)
        distance = (values - center).square().sum(1, keepdim=True)
        weights = given / (1 + distance / TOLERANCE**2).sqrt()
    return center


def _carried(
    values: Float[Tensor, "c h w"], known: Float[Tensor, "1 h w"], band: float
) -> Float[Tensor, "c h w"]:
    """Values, 0 where not known, continued into their surroundings, the wider ones last."""
    values, known = values[None], known[None]
    filled, share = values, known
    for reach in SURROUNDINGS_BANDS:
        near = _blur(known, reach * band)
        mean = _blur(values, reach * band) / near.clamp_min(EMPTY)
        full = (2 * near / _blur(torch.ones_like(known), reach * band)).clamp(max=1)
        new = (1 - share) * full
        filled, share = filled + new * mean, share + new
    return _blur(filled, band / 2)[0]


def _blur(planes: Float[Tensor, "v c h w"], sigma: float) -> Float[Tensor, "v c h w"]:
    """Gaussian, nothing (0) outside the picture."""
    from kornia.filters import gaussian_blur2d

    side = 2 * max(round(3 * sigma), 1) + 1
    return gaussian_blur2d(planes, side, (sigma, sigma), border_type="constant")
