"""Every metric of a scene, at a fixed list of views, beside pictures and the unedited scene.

A metric that cannot be measured has no value, and a reason with the next move in its place. Both
`gsedit metrics` and `gsedit edit` measure by `evaluate`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from math import sqrt
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.dataset import evenly_spaced
from gsedit.measures.agreement import (
    COMPARED_VIEWS,
    Pairs,
    PicturesOf,
    UneditedViews,
    WarpComparison,
    compare_renders,
    compare_targets,
    spread,
)
from gsedit.measures.evaluation_input import Evaluation, EvaluationInput, Mean, ViewMeasures
from gsedit.measures.interval import mean_interval
from gsedit.measures.metrics import (
    INSIDE,
    Fidelity,
    SquaredError,
    fidelity,
    rmse,
    squared_error,
)
from gsedit.measures.missing import MEASURED_ROLES, find_missing
from gsedit.measures.names import GROUND_TRUTH, METRICS
from gsedit.measures.outside import outside_means, pixels_outside
from gsedit.measures.points import (
    MATCHED_PIXELS,
    PointComparison,
    compare_points,
    matchable,
)
from gsedit.measures.references import measured_against
from gsedit.scene.picture import render_picture
from rasterizer.camera import Camera
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

Progress = Callable[[int, int], None]
"""(views measured, views to measure)."""


@dataclass(frozen=True, eq=False)
class _Measured:
    """The values of a view, and its part in what is pooled over views."""

    values: dict[str, float]
    outside: SquaredError | None


def evaluate(subject: EvaluationInput, progress: Progress = lambda done, total: None) -> Evaluation:
    """Measure a scene at the edited and held-out views of its list, a view at a time."""
    views = subject.views
    chosen = [i for i, role in enumerate(views.roles) if role in MEASURED_ROLES]
    perceptual = _perceptual_views(subject)
    of_views: dict[int, _Measured] = {}
    for done, i in enumerate(chosen, 1):
        of_views[i] = _measure_view(subject, i, perceptual)
        progress(done, len(chosen))
    warp, points = _warp(subject), _points(subject)
    measured: dict[str, dict[Any, Mean]] = {name: {} for name in (*METRICS, *GROUND_TRUTH)}
    for role in MEASURED_ROLES:
        for name, value in _means([of_views[i] for i in views.having(role)]).items():
            against = measured_against(name, role, subject)
            measured[name][role] = replace(value, against=against)
    for name, value in _outside_masks(subject).items():
        measured[name]["all"] = value
    measured = {name: by_role for name, by_role in measured.items() if by_role}
    compared = tuple(each for each in points.values() if isinstance(each, PointComparison))
    return Evaluation(
        measured,
        warp,
        find_missing(subject, measured, warp, points),
        tuple(
            ViewMeasures(views.viewpoints[i].name, views.roles[i], of_views[i].values)
            for i in chosen
        ),
        compared,
    )


@torch.no_grad()
def _measure_view(
    subject: EvaluationInput, i: int, perceptual: Collection[tuple[str, int]]
) -> _Measured:
    """The metrics of view i; `perceptual` are the comparisons that have a perceptual distance."""
    final = _final(subject, i)
    values: dict[str, float] = {}
    mask = subject.masks.get(i)

    def compare(expected: Tensor, to: str, mask: Tensor | None = None) -> None:
        nearness = fidelity(final, expected, mask, with_perceptual=(to, i) in perceptual)
        values.update(_named(nearness, to))

    if i in subject.targets and (mask is None or mask.any()):
        compare(subject.targets[i], "targets", mask)
    if i in subject.edits_alone:
        compare(subject.edits_alone[i], "edits_alone")
    if i in subject.ground_truth:
        compare(subject.ground_truth[i], "ground_truth")
    outside = None
    if subject.unedited is not None:
        unedited = _unedited(subject, subject.unedited, i)
        compare(unedited, "unedited")
        values["rmse_to_unedited"] = rmse(final, unedited)
        outside = _outside_region(subject, subject.unedited, i, unedited, final)
        if outside is not None:
            values["rmse_outside_region"] = sqrt(outside.total / outside.values)
    return _Measured(values, outside)


def _outside_region(
    subject: EvaluationInput,
    scene: Gaussians,
    i: int,
    unedited: Float[Tensor, "h w 3"],
    final: Float[Tensor, "h w 3"],
) -> SquaredError | None:
    """The change of view i outside the region; None where nothing is outside."""
    if subject.region is None or subject.region.is_all:
        return None
    parts = [(subject.region, scene)]
    if subject.edited_region is not None:
        parts.append((subject.edited_region, subject.scene))
    where = pixels_outside(parts, subject.views.viewpoints[i].camera, subject.execution)
    return squared_error(unedited, final, where) if where.any() else None


def _perceptual_views(subject: EvaluationInput) -> set[tuple[str, int]]:
    """The comparisons, by name and view, that have a perceptual distance."""
    every = range(len(subject.views))
    known = {
        "targets": subject.targets, "edits_alone": subject.edits_alone,
        "ground_truth": subject.ground_truth, "unedited": every,
    }  # fmt: skip
    chosen: set[tuple[str, int]] = set()
    for role in MEASURED_ROLES:
        for to, indices in known.items():
            views = [i for i in subject.views.having(role) if i in indices]
            most = subject.max_perceptual_views or len(views)
            chosen |= {(to, views[k]) for k in evenly_spaced(len(views), most)}
    return chosen


def _named(measures: Fidelity, to: str) -> dict[str, float]:
    return {f"{key}_to_{to}": value for key, value in asdict(measures).items() if value is not None}


def _means(of_views: Sequence[_Measured]) -> dict[str, Mean]:
    """Means over the views that have a value; errors outside the region are pooled over pixels."""
    names = dict.fromkeys(name for view in of_views for name in view.values)
    means = {
        name: _mean([view.values[name] for view in of_views if name in view.values])
        for name in names
    }
    outside = [view.outside for view in of_views if view.outside is not None]
    return means | outside_means(outside, "region", "")


def _mean(values: Sequence[float]) -> Mean:
    return Mean(sum(values) / len(values), len(values), mean_interval(values))


@torch.no_grad()
def _outside_masks(subject: EvaluationInput) -> dict[str, Mean]:
    """Errors outside the given masks, over views of any role."""
    if subject.unedited is None:
        return {}
    errors = [
        squared_error(_unedited(subject, subject.unedited, i), _final(subject, i), mask < INSIDE)
        for i, mask in subject.subject_masks.items()
    ]
    return outside_means([each for each in errors if each.values], "masks", "masks that were given")


def _final(subject: EvaluationInput, i: int) -> Float[Tensor, "h w 3"]:
    """The picture of the measured scene at view i, rendered unless it is there."""
    if i in subject.finals:
        return subject.finals[i]
    return render_picture(subject.scene, subject.views.viewpoints[i].camera, subject.execution)


def _unedited(subject: EvaluationInput, scene: Gaussians, i: int) -> Float[Tensor, "h w 3"]:
    """The picture of the unedited scene at view i, rendered unless it is there."""
    if i in subject.renderings:
        return subject.renderings[i].color.clamp(0, 1)
    return render_picture(scene, subject.views.viewpoints[i].camera, subject.execution)


def _warp(subject: EvaluationInput) -> tuple[WarpComparison, ...]:
    """Warp errors of targets and of renders at held-out views; none without the unedited scene."""
    original = subject.unedited
    if original is None:
        return ()
    cameras = [viewpoint.camera for viewpoint in subject.views.viewpoints]

    @cache
    @torch.no_grad()
    def rendering(i: int) -> Rendering:
        if i in subject.renderings:
            return subject.renderings[i]
        return render(original, cameras[i], median_depth=True, execution=subject.execution)

    views = UneditedViews(cameras, rendering)
    held_out = subject.views.having("held_out")
    edited = {i: subject.targets[i] for i in subject.views.having("edited") if i in subject.targets}
    compared = spread(held_out, COMPARED_VIEWS)
    return (
        *compare_targets(views, edited),
        *compare_renders(
            views, compared, held_out, lambda indices: {i: _final(subject, i) for i in indices}
        ),
    )


@torch.no_grad()
def _points(subject: EvaluationInput) -> dict[PicturesOf, PointComparison | str]:
    """Differences at matched points of the targets, and of renders at held-out views; or the reason
    why there are too few points. None without a matcher, or views that look alike."""
    scene, views = subject.unedited, subject.views
    if scene is None or subject.matcher is None:
        return {}
    cameras = [viewpoint.camera for viewpoint in views.viewpoints]
    targets = [i for i in views.having("edited") if i in subject.targets]
    pairs: dict[PicturesOf, Pairs] = {
        "targets": matchable(targets, cameras),
        "renders": matchable(views.having("held_out"), cameras),
    }
    every = sorted({pair for each in pairs.values() for pair in each})
    chosen = sorted({i for pair in every for i in pair})
    large = {i: _at_least(cameras[i], MATCHED_PIXELS) for i in chosen}
    pictures = {i: render_picture(scene, large[i], subject.execution) for i in chosen}
    matches = subject.matcher(pictures, large, every) if every else {}
    before = {i: _unedited(subject, scene, i) for i in chosen}
    after = {"targets": subject.targets, "renders": {i: _final(subject, i) for i in chosen}}
    sizes = {i: (camera.width, camera.height) for i, camera in large.items()}
    return {
        kind: compare_points(
            {pair: matches[pair] for pair in pairs[kind] if pair in matches},
            before, after[kind], sizes, kind,
        )
        for kind in pairs
        if pairs[kind]
    }  # fmt: skip


def _at_least(camera: Camera, size: int) -> Camera:
    """The camera with `size` pixels on its longer side, if it has fewer."""
    scale = max(1.0, size / max(camera.width, camera.height))
    return camera.resized(round(camera.width * scale), round(camera.height * scale))
