"""Every metric of a scene, at a fixed list of views, beside pictures and the unedited scene.

What cannot be measured has no value, and a reason with the next move in its place. `gsedit edit`
measures its result with the same functions (gsedit.session.quality).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.measures import clip as clip_measures
from gsedit.measures.agreement import (
    COMPARED_VIEWS,
    Pictures,
    UneditedViews,
    WarpComparison,
    compare_renders,
    compare_targets,
    spread,
)
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import (
    INSIDE,
    NEAREST,
    Fidelity,
    SquaredError,
    edit_strength,
    fidelity,
    pooled_rmse,
    squared_error,
)
from gsedit.measures.missing import MEASURED_ROLES, find_missing
from gsedit.measures.names import METRICS
from gsedit.measures.subject import Evaluation, Mean, Subject, ViewMeasures
from gsedit.regions.region import coverage
from gsedit.views.view_list import Role
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

Progress = Callable[[int, int], None]
"""(views measured, views to measure)."""


@dataclass(frozen=True, eq=False)
class _Measured:
    """A view's values, and what is pooled over views."""

    values: dict[str, float]
    outside: SquaredError | None
    vectors: dict[str, Float[Tensor, " d"]]
    """CLIP's, of the edited and the unedited render."""


def evaluate(subject: Subject, progress: Progress = lambda done, total: None) -> Evaluation:
    """Measure a scene at the edited and held-out views of its list, a view at a time."""
    views = subject.views
    chosen = [i for i, role in enumerate(views.roles) if role in MEASURED_ROLES]
    words = _vectors_of_texts(subject)
    of_views: dict[int, _Measured] = {}
    for done, i in enumerate(chosen, 1):
        of_views[i] = _measure_view(subject, i, words)
        progress(done, len(chosen))
    warp = _warp(subject)
    measured: dict[str, dict[Role, Mean]] = {name: {} for name in METRICS}
    for role in MEASURED_ROLES:
        for name, value in _means([of_views[i] for i in views.having(role)]).items():
            measured[name][role] = value
    measured = {name: by_role for name, by_role in measured.items() if by_role}
    return Evaluation(
        measured,
        warp,
        find_missing(subject, measured, warp),
        tuple(
            ViewMeasures(views.viewpoints[i].name, views.roles[i], of_views[i].values)
            for i in chosen
        ),
    )


@torch.no_grad()
def _measure_view(subject: Subject, i: int, words: Mapping[str, Tensor]) -> _Measured:
    camera = subject.views.viewpoints[i].camera
    final = picture_of(subject.scene, camera, subject.execution)
    values: dict[str, float] = {}
    mask = subject.masks.get(i)
    if i in subject.targets and (mask is None or mask.any()):
        values |= _named(fidelity(final, subject.targets[i], mask), "targets")
    outside, vectors = None, {}
    unedited = None
    if subject.unedited is not None:
        unedited = picture_of(subject.unedited, camera, subject.execution)
        values |= _named(fidelity(final, unedited), "unedited")
        values["strength"] = edit_strength(unedited, final)
        if subject.region is not None and not subject.region.is_all:
            covered = coverage(subject.region, subject.unedited, camera, subject.execution)
            outside = squared_error(unedited, final, covered < INSIDE)
            if (leaked := pooled_rmse([outside])) is not None:
                values["leakage"] = leaked
    if subject.clip is not None:
        vectors = {"edited": subject.clip.images(final[None])[0]}
        if unedited is not None:
            vectors["unedited"] = subject.clip.images(unedited[None])[0]
        values |= _clip_values(vectors, words)
    if subject.conse is not None and subject.texts.wanted:
        values |= subject.conse.values(subject.texts.wanted, final, unedited)
    return _Measured(values, outside, vectors)


def picture_of(
    scene: Gaussians, camera: Camera, execution: Execution = AUTO
) -> Float[Tensor, "h w 3"]:
    """A render in [0, 1], without gradients."""
    with torch.no_grad():
        return render(scene, camera, execution=execution).color.clamp(0, 1)


def _named(measures: Fidelity, to: str) -> dict[str, float]:
    return {f"{key}_to_{to}": value for key, value in asdict(measures).items() if value is not None}


def _vectors_of_texts(subject: Subject) -> dict[str, Tensor]:
    """CLIP's vectors of the texts that were given."""
    if subject.clip is None:
        return {}
    texts = {"wanted": subject.texts.wanted, "source": subject.texts.source}
    texts["target"] = subject.texts.target
    given = {name: text for name, text in texts.items() if text}
    return dict(zip(given, subject.clip.texts(list(given.values())))) if given else {}


def _clip_values(
    vectors: Mapping[str, Float[Tensor, " d"]], words: Mapping[str, Float[Tensor, " d"]]
) -> dict[str, float]:
    """Those of CLIP's measures that a single view has."""
    values = {}
    edited, unedited = vectors["edited"], vectors.get("unedited")
    if "wanted" in words:
        values["clip_similarity"] = float(clip_measures.similarity(edited, words["wanted"]))
    if unedited is not None:
        values["clip_preservation"] = float(clip_measures.similarity(edited, unedited))
        if "source" in words and "target" in words:
            values["clip_direction"] = float(
                clip_measures.direction(
                    edited[None], unedited[None], words["target"], words["source"]
                )[0]
            )
    return values


def _means(of_views: Sequence[_Measured]) -> dict[str, Mean]:
    """Over the views that have a value; leakage is pooled over all pixels outside."""
    names = dict.fromkeys(name for view in of_views for name in view.values)
    means = {
        name: _mean([view.values[name] for view in of_views if name in view.values])
        for name in names
    }
    if "leakage" in means:
        leaked = pooled_rmse(view.outside for view in of_views if view.outside is not None)
        assert leaked is not None
        views = means["leakage"].views
        means["leakage"] = Mean(leaked, views)
        means["kept"] = Mean(min(psnr_from_rmse(leaked), NEAREST), views)
    frames = [view.vectors for view in of_views if "unedited" in view.vectors]
    if len(frames) > 1:
        edited, unedited = (
            torch.stack([each[name] for each in frames]) for name in ("edited", "unedited")
        )
        consistency = clip_measures.direction_consistency(edited, unedited)
        means["clip_consistency"] = Mean(float(consistency.mean()), len(frames))
    return means


def _mean(values: Sequence[float]) -> Mean:
    return Mean(sum(values) / len(values), len(values))


def _warp(subject: Subject) -> tuple[WarpComparison, ...]:
    """Of the targets and of renders at held-out views; nothing without the unedited scene."""
    original = subject.unedited
    if original is None:
        return ()
    cameras = [viewpoint.camera for viewpoint in subject.views.viewpoints]

    @cache
    def rendering(i: int) -> Rendering:
        with torch.no_grad():
            return render(original, cameras[i], median_depth=True, execution=subject.execution)

    def finals(indices: Sequence[int]) -> Pictures:
        return {i: picture_of(subject.scene, cameras[i], subject.execution) for i in indices}

    views = UneditedViews(cameras, rendering)
    held_out = subject.views.having("held_out")
    edited = {i: subject.targets[i] for i in subject.views.having("edited") if i in subject.targets}
    compared = spread(held_out, COMPARED_VIEWS)
    return (
        *compare_targets(views, edited),
        *compare_renders(views, compared, held_out, finals),
    )
