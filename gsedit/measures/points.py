"""How far edited pictures agree at points that a matcher found in the unedited ones.

The method's depth is not asked, unlike for the warp error. Pictures are in [0, 1] and belong to
views by their index; positions are in pixels, with pixel centers at +0.5.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import cos, radians

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample

from gsedit.measures.agreement import Pairs, Pictures, PicturesOf, added, excess_interval, spread
from gsedit.measures.interval import Interval
from rasterizer.camera import Camera

Positions = Float[Tensor, "m 2"]
Matches = Mapping[tuple[int, int], tuple[Positions, Positions]]
"""Positions of the same points in both views of a pair."""
Matcher = Callable[[Pictures, Mapping[int, Camera], Pairs], Matches]
MATCHED_PIXELS = 512
"""Longer side, at least, of the pictures that are matched: the bear's views eight photos apart have
58 matches at 256 pixels, 217 at 512."""
MATCHED_VIEWS = 12
"""Most views of a kind that are matched."""
MOST_DEGREES = 60.0
"""Angle between cameras beyond which SIFT matches next to nothing."""
CHANGED = 0.02
"""RMSE over channels from which the edit changed a point's color in one of two views: five levels
of 255, under which a picture looks unedited. Other points agree as before, and would hide the
rest."""
FEWEST_POINTS = 50
"""Fewest changed points of which an error is told."""


@dataclass(frozen=True)
class PointComparison:
    """The RMSE of color (mean over channels) between views at matched points that the edit
    changed."""

    pictures: PicturesOf
    points: int
    """Matched points that the edit changed, those of every pair of views."""
    matched: int
    """Points that were matched, changed or not."""
    pairs: int
    """Pairs of views with changed points."""
    unedited: float
    edited: float
    interval: Interval | None
    """The interval of the excess over views."""

    @property
    def excess(self) -> float:
        """The error that the edit added, in quadrature, as that of a warp error."""
        return added(self.edited, self.unedited)


def matchable(views: Sequence[int], cameras: Sequence[Camera]) -> Pairs:
    """Every two of at most MATCHED_VIEWS of the views whose cameras look in similar directions."""
    least = cos(radians(MOST_DEGREES))
    pairs = combinations(sorted(spread(views, MATCHED_VIEWS)), 2)
    return [(a, b) for a, b in pairs if float(cameras[a].forward @ cameras[b].forward) > least]


def compare_points(
    matches: Matches,
    unedited: Pictures,
    edited: Pictures,
    sizes: Mapping[int, tuple[int, int]],
    pictures: PicturesOf,
    least_change: float = CHANGED,
) -> PointComparison | str:
    """Both errors at the same points, or the reason why they are too few.

    Positions are those of pictures of the `sizes` (width, height).
    """
    sums, views, matched = [], [], 0
    for pair, positions in matches.items():
        before, after = (
            [_at(images[i], xy, sizes[i]) for i, xy in zip(pair, positions)]
            for images in (unedited, edited)
        )
        moved = torch.stack([(b - a).square().mean(1) for a, b in zip(before, after)])
        kept = moved.amax(0) >= least_change**2
        matched += len(kept)
        if kept.any():
            errors = [(a - b).square().mean(1)[kept].sum().item() for a, b in (before, after)]
            sums.append((*errors, float(kept.sum())))
            views.append(pair)
    points = int(sum(each[-1] for each in sums))
    if points < FEWEST_POINTS:
        return (
            f"{matched} points were matched between views, {points} of them where the edit changed "
            f"a color: {FEWEST_POINTS} are needed; measure at views that are nearer to each other"
        )
    total = np.sum(sums, 0)
    before, after = np.sqrt(total[:2] / total[2]).tolist()
    within = excess_interval(sums, views)
    return PointComparison(pictures, points, matched, len(views), before, after, within)


def _at(
    image: Float[Tensor, "h w 3"], xy: Positions, size: tuple[int, int]
) -> Float[Tensor, "m 3"]:
    """Colors at positions in a picture of that (width, height), between pixels linearly."""
    grid = (2 * xy / torch.tensor(size) - 1).to(image)[None, :, None]
    colors = grid_sample(
        image.permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=False
    )
    return colors[0, :, :, 0].T.double()
