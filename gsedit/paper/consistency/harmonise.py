"""Finished pictures made to agree, whatever editor made them.

`v` views of `h w` pixels; `k` pictures of one place.

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
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.depth_maps import warp_of
from rasterizer.camera import Camera

TOLERANCE = 0.1
"""Colors that lie this near the agreed one count in full, farther ones less and less: a view's own
tint is averaged, a view with another edit is outvoted. A tenth of the range: between what editors
differ in by chance and what two variants of one edit differ in."""
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
) -> Float[Tensor, "v h w 3"]:
    """The pictures with their low bands led towards agreement, in [0, 1].

    Anchored pictures stay as they are, and where one shows a place it alone decides. Places that no
    other picture shows take the correction of their surroundings, or none.
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
        agreed[a] = (images[a] + correction).clamp(0, 1)
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
    """Location of the voters (at least one) at each pixel: the sum of pseudo-Huber distances is
    least.

    That is the mean for voters within TOLERANCE of it, and nears the geometric median (which half
    of them, less one, cannot drag away) for those far beyond. Found by reweighting from the mean
    (Weiszfeld's iteration, smoothed).
    """
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
