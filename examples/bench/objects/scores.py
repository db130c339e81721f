"""Measures of an edited scene's pictures against the exact ones, in and around the change.

`v` held-out views of `h w` pixels; pictures in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.measures.metrics import NEAREST, perceptual, psnr, ssim

CHANGES = 2 / 255
"""Difference of exact pictures that counts as a change."""
MARGIN = 2
"""Pixels around a change that count as changed: splats reach as far."""
AROUND = 6
"""Pixels around a hole that are its surroundings."""
SMALLEST_BOX = 32
"""Pixels a side of the part of a picture that SSIM and the perceptual distance look at."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Right pictures of a case at its held-out views, and which pixels are which."""

    after: Float[Tensor, "v h w 3"]
    changed: Bool[Tensor, "v h w"]
    """Pixels that differ from before, and those next to them."""
    hole: Bool[Tensor, "v h w"]
    """Pixels that show the thing before."""
    unseen: Bool[Tensor, "v h w"]
    """Pixels of the hole that show a surface after, which no view of the capture shows."""


def changes(
    before: Float[Tensor, "v h w 3"], after: Float[Tensor, "v h w 3"]
) -> Bool[Tensor, "v h w"]:
    """Pixels that differ in exact pictures, and those next to them."""
    return widened((after - before).abs().amax(-1) > CHANGES, MARGIN)


def widened(mask: Bool[Tensor, "v h w"], pixels: int) -> Bool[Tensor, "v h w"]:
    """The mask with all pixels at most so many rows and columns away."""
    size = 2 * pixels + 1
    return torch.nn.functional.max_pool2d(mask[:, None].float(), size, 1, pixels)[:, 0] > 0


def scores(
    result: Float[Tensor, "v h w 3"], given: Float[Tensor, "v h w 3"], truth: Truth
) -> dict[str, float | None]:
    """Measures by name, PSNR in dB of all views together; None for what has no pixels.

    `given` are pictures of the unedited scene in its own representation: what is outside of the
    change is compared with those, and the change itself with the right pictures.
    """
    changed = truth.changed
    boxes = [_box(*views) for views in zip(result, truth.after, changed) if views[2].any()]
    distances = [each for box in boxes if (each := perceptual(*box)) is not None]
    return {
        "changed_psnr": decibels(result, truth.after, changed),
        "changed_ssim": fmean(ssim(*box) for box in boxes) if boxes else None,
        "changed_perceptual": fmean(distances) if distances else None,
        "outside_psnr": decibels(result, given, ~changed),
        "hole_psnr": decibels(result, truth.after, truth.hole),
        "unseen_psnr": decibels(result, truth.after, truth.unseen),
        "seam": seam(result, truth.after, truth.hole),
    }


def decibels(
    image: Float[Tensor, "v h w 3"],
    target: Float[Tensor, "v h w 3"],
    mask: Bool[Tensor, "v h w"],
) -> float | None:
    """PSNR, dB, where the mask is True; None for an empty one."""
    return min(psnr(image, target, mask), NEAREST) if mask.any() else None


def seam(
    result: Float[Tensor, "v h w 3"], after: Float[Tensor, "v h w 3"], hole: Bool[Tensor, "v h w"]
) -> float | None:
    """How much more the error jumps across the border of the hole than around it: the RMSE of
    differences of the error between neighbors, one in the hole and one not, over that of
    neighbors near the hole; None where nothing is to be compared."""
    error = result - after
    near = widened(hole, AROUND) & ~hole
    across, around = [], []
    for axis in (1, 2):
        size = error.shape[axis] - 1
        first, second = (error.narrow(axis, i, size) for i in (0, 1))
        jump = (first - second).square().mean(-1)
        a, b = (hole.narrow(axis, i, size) for i in (0, 1))
        c, d = (near.narrow(axis, i, size) for i in (0, 1))
        across.append(jump[(a & d) | (b & c)])
        around.append(jump[c & d])
    border, ring = torch.cat(across), torch.cat(around)
    if not len(border) or not float(ring.sum()):
        return None
    return float((border.mean() / ring.mean()).sqrt())


def _box(
    image: Float[Tensor, "h w 3"], target: Float[Tensor, "h w 3"], mask: Bool[Tensor, "h w"]
) -> tuple[Float[Tensor, "a b 3"], Float[Tensor, "a b 3"]]:
    """The part of both pictures around the mask, with the target's pixels where it is False."""
    image = torch.where(mask[..., None], image, target)
    ranges = []
    for axis, length in ((1, mask.shape[0]), (0, mask.shape[1])):
        rows = mask.any(axis).nonzero().squeeze(-1)
        low, high = int(rows.min()), int(rows.max()) + 1
        missing = max(SMALLEST_BOX - (high - low), 0)
        low = max(min(low - missing // 2, length - SMALLEST_BOX), 0)
        ranges.append(slice(low, max(high, low + SMALLEST_BOX)))
    return image[ranges[0], ranges[1]], target[ranges[0], ranges[1]]
