"""Finished pictures made to agree, for editors that cannot be sampled together.

`v` views of `h w` pixels, `y x` cells, `n` = y x cells in a view, `k` clusters, `m` cells that are
in one. Diffusion editors make views agree while they are sampled (see consensus.py); a program
returns finished pictures, one of which may show another edit than the rest. So the colors of
corresponding cells are brought to a *robust* mean, by a correction without fine detail: matches
are exact to half a cell only, and detail averaged at that precision would be blurred.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.consistency.correspond import Correspondences
from gsedit.errors import UsageError

TOLERANCE = 0.1
"""Colors that lie this near the agreed one count in full, farther ones less and less: a view's own
tint is averaged, a view with another edit is outvoted. A tenth of the range: between what editors
differ in by chance and what two variants of one edit differ in."""
ROUNDS = 20
"""Rounds of reweighting; each moves the mean by less than half of the one before."""
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
    for _ in range(ROUNDS + 1):
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
    blurred = _blur(torch.cat((difference.movedim(-1, 1) * mask, mask, torch.ones_like(mask)), 1))
    share, inside = blurred[:, 3:4], blurred[:, 4:]
    full = (2 * share / inside).clamp(max=1)
    return (blurred[:, :3] / share.clamp_min(1e-6) * full).movedim(1, -1)


def _blur(grid: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
    """Gaussian, nothing (0) outside the picture."""
    from kornia.filters import gaussian_blur2d

    side = 2 * round(3 * SMOOTHING) + 1
    return gaussian_blur2d(grid, side, (SMOOTHING, SMOOTHING), "constant")
