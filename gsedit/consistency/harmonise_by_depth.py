"""Edited pictures brought to agreement at pixel resolution, in their coarse colours.

`v` views of `h w` pixels, `k` pictures of one place. Consensus while sampling reaches the cells
that match. More of two pictures shows the same surface than cells do (a match is mutual, and fills
a cell), and the rendered depth of the unedited scene says where. So after sampling the low band of
every picture is led to the robust mean of what the others show at the same places. What is finer
stays each view's own: depth is not exact enough for it, and the scene's own detail is in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.consistency.harmonise import TOLERANCE
from gsedit.consistency.warp import Warp, warp_of
from rasterizer.camera import Camera

BAND = 1 / 128
"""Standard deviation of the blur that leaves the low band, in longer sides of a picture: half of a
cell of `small` at 256 pixels."""
REACH = (2.0, 8.0)
"""The correction of what corresponds is carried to what does not, in full where half of the
surroundings correspond, and less beyond; widths of these surroundings, in bands."""
ROUNDS = 3
"""A blurred correction brings the pictures to agreement only in part: it is repeated."""
REWEIGHTINGS = 4
"""Of the robust mean."""


class Surface(NamedTuple):
    """What the unedited scene shows at a view."""

    camera: Camera
    depth: Float[Tensor, "h w"]
    """Median depth."""
    alpha: Float[Tensor, "h w"]


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
    warps = {a: [warp_of(*surfaces[a], *surfaces[b]) for b in others[a]] for a in free}
    agreed = images.clone()
    for _ in range(ROUNDS):
        low = low_band(agreed)
        for a in free:
            decides = [False, *(led[b] for b in others[a])]
            correction = _correction(low, a, others[a], warps[a], decides)
            agreed[a] = (agreed[a] + strength * correction).clamp(0, 1)
    return agreed


def low_band(images: Float[Tensor, "v h w c"]) -> Float[Tensor, "v h w c"]:
    """Blurred by BAND, from within the picture only."""
    planes = images.movedim(-1, 1)
    sigma = _band(planes)
    return (_blur(planes, sigma) / _blur(torch.ones_like(planes[:1, :1]), sigma)).movedim(1, -1)


def _correction(
    low: Float[Tensor, "v h w 3"],
    a: int,
    others: Sequence[int],
    warps: Sequence[Warp],
    decides: Sequence[bool],
) -> Float[Tensor, "h w 3"]:
    """What leads view a's low band to the agreed one; smooth."""
    pictures = torch.stack([low[a], *(warp(low[b]) for b, warp in zip(others, warps))])
    shown = torch.stack([torch.ones_like(warps[0].valid), *(w.valid for w in warps)])
    leads = shown & torch.tensor(decides)[:, None, None]
    voters = torch.where(leads.any(0), leads, shown)
    known = shown[1:].any(0)
    difference = (_robust_mean(pictures, voters) - low[a]) * known[..., None]
    return _carried(difference, known)


def _robust_mean(
    pictures: Float[Tensor, "k h w 3"], voters: Bool[Tensor, "k h w"]
) -> Float[Tensor, "h w 3"]:
    """Of the voters at each pixel, as `harmonise.robust_mean`; there is one at least."""
    given = voters[..., None].to(pictures)
    weights = given
    for _ in range(REWEIGHTINGS):
        centre = (weights * pictures).sum(0) / weights.sum(0)
        distance = (pictures - centre).square().sum(-1, keepdim=True)
        weights = given / (1 + distance / TOLERANCE**2).sqrt()
    return (weights * pictures).sum(0) / weights.sum(0)


def _carried(
    difference: Float[Tensor, "h w 3"], known: Bool[Tensor, "h w"]
) -> Float[Tensor, "h w 3"]:
    """The difference where it is known, continued into its surroundings, wider ones last."""
    planes, mask = difference.movedim(-1, 0)[None], known[None, None].to(difference)
    band, filled, share = _band(planes), planes.clone(), mask.clone()
    for reach in REACH:
        near = _blur(mask, reach * band)
        mean = _blur(planes, reach * band) / near.clamp_min(1e-6)
        full = (2 * near / _blur(torch.ones_like(mask), reach * band)).clamp(max=1)
        new = (1 - share) * full
        filled, share = filled + new * mean, share + new
    return _blur(filled, band / 2)[0].movedim(0, -1)


def _band(planes: Float[Tensor, "v c h w"]) -> float:
    """Pixels."""
    return BAND * max(planes.shape[-2:])


def _blur(planes: Float[Tensor, "v c h w"], sigma: float) -> Float[Tensor, "v c h w"]:
    """Gaussian, nothing (0) outside the picture."""
    radius = max(round(3 * sigma), 1)
    at = torch.arange(-radius, radius + 1, dtype=planes.dtype)
    kernel = (-0.5 * (at / sigma) ** 2).exp()
    kernel = (kernel / kernel.sum()).expand(planes.shape[1], 1, -1)
    channels = planes.shape[1]
    rows = F.conv2d(planes, kernel[..., None, :], padding=(0, radius), groups=channels)
    return F.conv2d(rows, kernel[..., None], padding=(radius, 0), groups=channels)
