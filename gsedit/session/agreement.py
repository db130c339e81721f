"""How far pictures of different views agree on colour, beside the unedited scene's own renders."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import copysign, sqrt
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.warp import warp
from gsedit.session.session import Session
from gsedit.views.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.render import Rendering

PAIRS = 8
"""Most pairs of views that a row measures: a warp costs as much as a render."""
COMPARED = 0.01
"""Least share of a picture's pixels that a pair must both see: an error over fewer means little."""

Range = Literal["short", "long"]
Pairs = Sequence[tuple[int, int]]


@dataclass(frozen=True)
class WarpComparison:
    """Warp error of one set of pictures: the RMSE of colour (mean over channels) between a view and
    another one warped into it by the unedited scene's depth, over all pixels that both see."""

    pictures: Literal["targets", "renders"]
    """The edited 2D pictures, or renders of the edited scene."""
    range: Range
    """short: a view and the camera nearest to it. long: for targets every other pair that shares
    1 % of the pixels; for renders a held-out view and the nearest other one, which in a capture
    taken in order is eight pictures away."""
    pairs: int
    compared: float
    """Mean share of a view's pixels that were compared."""
    unedited: float
    """Of renders of the unedited scene, on the same pixels: shading, resampling and what its depth
    gets wrong."""
    edited: float

    @property
    def excess(self) -> float:
        """What the edit added, in quadrature; below 0 where the edited pictures agree better."""
        square = self.edited**2 - self.unedited**2
        return copysign(sqrt(abs(square)), square)


def compare_targets(session: Session) -> tuple[WarpComparison, ...]:
    """The edited 2D pictures, in pairs of short and of long range; no row where none share 1 %."""
    images = {i: view.image for i, view in session.edited.targets.items()}
    short = sorted({pair for i in images for pair in _with_nearest(session, i, images)})
    every = itertools.combinations(sorted(images), 2)
    long = [pair for pair in every if pair not in short]
    rows = (
        _compare(session, images, "targets", "short", _evenly(short)),
        _compare(session, images, "targets", "long", _evenly(long)),
    )
    return tuple(row for row in rows if row)


def compare_renders(
    session: Session, finals: Mapping[int, Float[Tensor, "h w 3"]], views: Iterable[int]
) -> tuple[WarpComparison, ...]:
    """The edited scene at the held-out `views`, each with the nearest camera and the nearest
    held-out camera; no row where none share 1 %. `finals` are renders that exist already."""
    views = tuple(views)
    short = [pair for i in views for pair in _with_nearest(session, i, range(len(session.views)))]
    long = [pair for i in views for pair in _with_nearest(session, i, session.held_out)]
    missing = sorted({i for pair in (*short, *long) for i in pair} - set(finals))
    cameras = [session.views[i].camera for i in missing]
    images = {**finals, **dict(zip(missing, session.render(cameras)))}
    rows = (
        _compare(session, images, "renders", "short", short),
        _compare(session, images, "renders", "long", long),
    )
    return tuple(row for row in rows if row)


@torch.no_grad()
def _compare(
    session: Session,
    images: Mapping[int, Float[Tensor, "h w 3"]],
    pictures: Literal["targets", "renders"],
    range_: Range,
    pairs: Pairs,
) -> WarpComparison | None:
    """Both errors over the same pixels, from one warp of both pictures a pair."""
    shares, squares = [], []
    for a, b in pairs:
        here, there = (session.unedited_rendering(i) for i in (a, b))
        both_a, both_b = (
            torch.cat((rendering.color.clamp(0, 1), images[i]), -1)
            for i, rendering in ((a, here), (b, there))
        )
        cameras = (session.views[a].camera, session.views[b].camera)
        warped, valid = warp(both_b, cameras[0], *_surface(here), cameras[1], *_surface(there))
        share = valid.double().mean().item()
        if share >= COMPARED:
            error = (warped - both_a)[valid].double().square().mean(0)
            shares.append(share)
            squares.append(share * error.reshape(2, 3).mean(1))
    if not shares:
        return None
    unedited, edited = (torch.stack(squares).sum(0) / sum(shares)).sqrt().tolist()
    return WarpComparison(
        pictures, range_, len(shares), sum(shares) / len(shares), unedited, edited
    )


def _surface(rendering: Rendering) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """(median depth, alpha) of a rendering that was asked for depth."""
    assert rendering.median_depth is not None
    return rendering.median_depth, rendering.alpha


def _evenly(pairs: Pairs) -> Pairs:
    return [pairs[i] for i in evenly_spaced(len(pairs), PAIRS)] if pairs else []


def _with_nearest(session: Session, i: int, others: Iterable[int]) -> Pairs:
    """(i, the view among `others` whose camera is nearest to it), if there is another."""
    ordered = nearest(session, i, (j for j in others if j != i))
    return [(i, j) for j in ordered[:1]]


def nearest(session: Session, i: int, others: Iterable[int]) -> list[int]:
    """The views `others`, the one whose camera is nearest to view i's first."""
    depth, alpha = _surface(session.unedited_rendering(i))
    seen = depth[alpha > 0.5]
    reach = float(seen.median()) if len(seen) else 1.0
    camera = session.views[i].camera
    return sorted(others, key=lambda j: _displacement(camera, session.views[j].camera, reach))


def _displacement(a: Camera, b: Camera, depth: float) -> float:
    """About how far a pixel at that depth moves between two cameras, in radians."""
    (axis_a, axis_b), (centre_a, centre_b) = (
        [camera.world_to_camera[2, :3].double() for camera in (a, b)],
        [camera.centre.double() for camera in (a, b)],
    )
    turned = torch.acos((axis_a @ axis_b).clamp(-1, 1))
    return float((centre_a - centre_b).norm() / depth + turned)
