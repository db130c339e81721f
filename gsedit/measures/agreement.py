"""How far pictures of different views agree on color, beside the unedited scene's own renders.

Two ways: the warp error compares a view with another one warped into it by the unedited scene's
depth; the difference at points compares colors where a matcher found the same points, and does not
ask for that depth. Pictures are in [0, 1] and belong to views by their index; positions are in
pixels, with pixel centers at +0.5.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, radians
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample

from gsedit.measures.formulas import Interval, interval
from gsedit.views.dataset import evenly_spaced
from gsedit.views.depth_maps import warp_of
from rasterizer.camera import Camera
from rasterizer.render import Rendering

PAIRS = 8
"""Most pairs of views that a row measures: a warp costs as much as a render."""
COMPARED_VIEWS = 4
"""Held-out views whose renders are compared with those of nearby cameras."""

Range = Literal["short", "long"]
PicturesOf = Literal["targets", "renders"]
"""The edited 2D pictures, or renders of the edited scene."""
Pairs = Sequence[tuple[int, int]]
Pictures = Mapping[int, Float[Tensor, "h w 3"]]
"""By the index of the view."""


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


@dataclass(frozen=True, kw_only=True)
class PairComparison:
    """The RMSE of color (mean over channels) between views, before an edit and after it.

    Of a warp, over all pixels that both views see; of points, at those that the edit changed.
    """

    pictures: PicturesOf
    range: Range | None = None
    """Reach of a warp. short: a view and the camera nearest to it. long: for targets every other
    pair that shares 1 % of the pixels; for renders a held-out view and the nearest other one, which
    in a capture taken in order is eight pictures away. None: of points."""
    pairs: int
    """Pairs of views that were compared."""
    unedited: float
    """Error of renders of the unedited scene, at the same pixels: shading, resampling and what its
    depth gets wrong."""
    edited: float
    interval: Interval | None = None
    """The interval of the excess over views."""
    counts: Mapping[str, float]
    """Numbers of a warp: `compared`, the mean share of a view's pixels; else `points` and
    `matched`, the points of every pair that the edit changed, and those changed or not."""

    @property
    def name(self) -> str:
        """Name of the row in records."""
        return f"warp_{self.pictures}_{self.range}" if self.range else f"points_{self.pictures}"

    @property
    def excess(self) -> float:
        """Error that the edit added, in quadrature; below 0 where the edited pictures agree
        better."""
        return added(self.edited, self.unedited)

    def record(self) -> dict[str, Any]:
        """The row as JSON has it."""
        warped = "a warp by the unedited scene's depth, which the method uses too"
        return {
            "unedited": self.unedited,
            "edited": self.edited,
            "excess": self.excess,
            "excess_interval": self.interval,
            "pairs": self.pairs,
            "against": warped if self.range else "SIFT matches of the unedited renders",
            **self.counts,
        }


@dataclass(frozen=True, eq=False)
class UneditedViews:
    """The unedited scene, as its views show it."""

    cameras: Sequence[Camera]
    rendering: Callable[[int], Rendering]
    """Render of the unedited scene at the view of that index, with median depth."""
    short: bool = False
    """Whether pairs of short range alone are compared."""

    def nearest(self, i: int, others: Iterable[int]) -> list[int]:
        """The views `others`, the one whose camera is nearest to view i's first."""
        depth, alpha = _surface(self.rendering(i))
        seen = depth[alpha > 0.5]
        reach = float(seen.median()) if len(seen) else 1.0
        camera = self.cameras[i]
        return sorted(others, key=lambda j: _displacement(camera, self.cameras[j], reach))

    def with_nearest(self, i: int, others: Iterable[int]) -> Pairs:
        """(i, the view among `others` whose camera is nearest to it), if there is another."""
        ordered = self.nearest(i, (j for j in others if j != i))
        return [(i, j) for j in ordered[:1]]


def spread(indices: Sequence[int], number: int) -> tuple[int, ...]:
    """At most `number` of them, those in the middle of equal parts."""
    number = min(number, len(indices))
    return tuple(indices[(2 * k + 1) * len(indices) // (2 * number)] for k in range(number))


def compare_targets(views: UneditedViews, targets: Pictures) -> tuple[PairComparison, ...]:
    """The edited 2D pictures, in pairs of short and of long range; no row where none share 1 %."""
    short = sorted({pair for i in targets for pair in views.with_nearest(i, targets)})
    every = itertools.combinations(sorted(targets), 2)
    long = [pair for pair in every if pair not in short]
    some = [[pairs[i] for i in evenly_spaced(len(pairs), PAIRS)] for pairs in (short, long)]
    return _both_ranges(views, targets, "targets", *some)


def compare_renders(
    views: UneditedViews,
    compared: Iterable[int],
    held_out: Sequence[int],
    finals: Callable[[Sequence[int]], Pictures],
) -> tuple[PairComparison, ...]:
    """The edited scene at the held-out views `compared`, each with the nearest camera and the
    nearest held-out camera; no row where none share 1 %. `finals` renders the edited scene."""
    compared = tuple(compared)
    every = range(len(views.cameras))
    short = [pair for i in compared for pair in views.with_nearest(i, every)]
    long = [pair for i in compared for pair in views.with_nearest(i, held_out)]
    images = finals(sorted({i for pair in (*short, *long) for i in pair}))
    return _both_ranges(views, images, "renders", short, long)


def _both_ranges(
    views: UneditedViews, images: Pictures, pictures: PicturesOf, short: Pairs, long: Pairs
) -> tuple[PairComparison, ...]:
    near = compare_pairs(views, images, pictures, "short", short)
    far = None if views.short else compare_pairs(views, images, pictures, "long", long)
    return tuple(row for row in (near, far) if row)


@torch.no_grad()
def compare_pairs(
    views: UneditedViews, images: Pictures, pictures: PicturesOf, range_: Range, pairs: Pairs
) -> PairComparison | None:
    """Both errors over the same pixels, from one warp of both pictures a pair; None where no pair
    shares 1 % of its pixels."""
    shares, squares, members = [], [], []
    for a, b in pairs:
        here, there = (views.rendering(i) for i in (a, b))
        both_a, both_b = (
            torch.cat((rendering.color.clamp(0, 1), images[i]), -1)
            for i, rendering in ((a, here), (b, there))
        )
        cameras = (views.cameras[a], views.cameras[b])
        found = warp_of(cameras[0], *_surface(here), cameras[1], *_surface(there))
        warped, valid = found(both_b), found.valid
        share = valid.double().mean().item()
        if share >= 0.01:  # an error over fewer pixels means little
            error = (warped - both_a)[valid].double().square().mean(0)
            shares.append(share)
            squares.append(share * error.reshape(2, 3).mean(1))
            members.append((a, b))
    if not shares:
        return None
    unedited, edited = (torch.stack(squares).sum(0) / sum(shares)).sqrt().tolist()
    sums = [(*square.tolist(), share) for square, share in zip(squares, shares)]
    return PairComparison(
        pictures=pictures, range=range_, pairs=len(shares), unedited=unedited, edited=edited,
        interval=excess_interval(sums, members), counts={"compared": sum(shares) / len(shares)},
    )  # fmt: skip


def matchable(views: Sequence[int], cameras: Sequence[Camera]) -> Pairs:
    """Every two of at most MATCHED_VIEWS of the views whose cameras look in similar directions."""
    least = cos(radians(MOST_DEGREES))
    pairs = itertools.combinations(sorted(spread(views, MATCHED_VIEWS)), 2)
    return [(a, b) for a, b in pairs if float(cameras[a].forward @ cameras[b].forward) > least]


def compare_points(
    matches: Matches,
    unedited: Pictures,
    edited: Pictures,
    sizes: Mapping[int, tuple[int, int]],
    pictures: PicturesOf,
) -> PairComparison | str:
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
        kept = moved.amax(0) >= CHANGED**2
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
    return PairComparison(
        pictures=pictures, pairs=len(views), unedited=before, edited=after,
        interval=excess_interval(sums, views), counts={"points": points, "matched": matched},
    )  # fmt: skip


def added(edited: float, unedited: float) -> float:
    """The error that an edit added to one that was there, in quadrature; below 0 where it took
    away."""
    return float(signed_root(np.array([edited**2 - unedited**2]))[0])


def signed_root(square: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The roots of differences of squares, with the signs of the differences."""
    return np.copysign(np.sqrt(np.abs(square)), square)


def excess_interval(sums: Sequence[Sequence[float]], pairs: Pairs) -> Interval | None:
    """The interval of an excess, from the squared error before, the one after, and the weight of
    each pair of views."""
    return interval(sums, pairs, lambda sums: signed_root((sums[1] - sums[0]) / sums[2]))


def _surface(rendering: Rendering) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """(median depth, alpha) of a rendering that was asked for depth."""
    assert rendering.median_depth is not None
    return rendering.median_depth, rendering.alpha


def _displacement(a: Camera, b: Camera, depth: float) -> float:
    """About how far a pixel at that depth moves between two cameras, in radians."""
    (axis_a, axis_b), (center_a, center_b) = (
        [camera.world_to_camera[2, :3].double() for camera in (a, b)],
        [camera.center.double() for camera in (a, b)],
    )
    turned = torch.acos((axis_a @ axis_b).clamp(-1, 1))
    return float((center_a - center_b).norm() / depth + turned)


def _at(
    image: Float[Tensor, "h w 3"], xy: Positions, size: tuple[int, int]
) -> Float[Tensor, "m 3"]:
    """Colors at positions in a picture of that (width, height), between pixels linearly."""
    grid = (2 * xy / torch.tensor(size) - 1).to(image)[None, :, None]
    colors = grid_sample(
        image.permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=False
    )
    return colors[0, :, :, 0].T.double()
