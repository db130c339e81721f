"""Evaluate the result of an edit that a 2D editor drew, and gather its evidence: measurements, the
pictures that show it, and the work that it took."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.measures.against import TARGETS_ARE
from gsedit.measures.agreement import Pictures, UneditedViews, spread
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.evaluation import evaluate
from gsedit.measures.formulas import psnr
from gsedit.measures.metrics import Evaluation, EvaluationInput, Means
from gsedit.paper.edit_views import MEASURE, match_views, sample_views
from gsedit.paper.request import name_of
from gsedit.paper.session import Session, Work, preview
from gsedit.paper.settings import EditSettings
from gsedit.paper.skips import Decision
from gsedit.paper.view_plan import ViewPlan
from gsedit.run.events import Event
from gsedit.scene.outcome import Outcome
from gsedit.select.region import Region
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.view_list_files import Role, ViewList
from gsedit.views.viewpoints import Viewpoint
from rasterizer.render import render_picture


@dataclass(frozen=True)
class EditMetrics:
    """The evaluation of an edited scene, and how well its views matched.

    A metric has its name of gsedit.measures.metrics; `evaluation.value(NAME, ROLE)` reads any of
    them. The properties are those to read first, None where they were not measured.
    """

    evaluation: Evaluation
    pairs: tuple[tuple[str, str, float], ...] = ()
    """(view, view, matched fraction of latent cells) of every two views edited in one batch."""

    @property
    def matched(self) -> float | None:
        """Mean matched fraction of the pairs; None without any."""
        shares = [share for *_, share in self.pairs]
        return sum(shares) / len(shares) if shares else None

    @property
    def rmse_to_unedited(self) -> float | None:
        """RMSE between renders of the unedited and the edited scene: 0 is no edit at all."""
        edited = self.evaluation.value("rmse_to_unedited")
        return self.evaluation.value("rmse_to_unedited", "held_out") if edited is None else edited

    @property
    def psnr_to_targets(self) -> float | None:
        """Mean PSNR to the edited 2D pictures that the scene was fitted to, dB.

        It says how far the scene follows them, not how good they are.
        """
        return self.evaluation.value("psnr_to_targets")

    @property
    def psnr_to_held_out_edits(self) -> float | None:
        """Mean PSNR to pictures that the 2D editor makes of held-out views, dB."""
        return self.evaluation.value("psnr_to_targets", "held_out")

    @property
    def psnr_to_edits_alone(self) -> float | None:
        """Mean PSNR to pictures of the same views that were made without the targets, dB."""
        return self.evaluation.value("psnr_to_edits_alone", "held_out")

    @property
    def psnr_to_ground_truth(self) -> float | None:
        """Mean PSNR to the true edit at the held-out cameras, dB."""
        return self.evaluation.value("psnr_to_ground_truth", "held_out")

    @property
    def rmse_outside_region(self) -> float | None:
        """RMSE to the unedited scene at the edited views, over pixels outside the region."""
        return self.evaluation.value("rmse_outside_region")

    @property
    def psnr_outside_region(self) -> float | None:
        """PSNR to the unedited scene at held-out cameras, dB, over pixels outside the region."""
        return self.evaluation.value("psnr_outside_region", "held_out")

    def with_means(self, means: Means) -> EditMetrics:
        """These, with means that were measured anew."""
        measured = {**self.evaluation.measured, **means}
        return replace(self, evaluation=replace(self.evaluation, measured=measured))

    def record(self) -> dict[str, Any]:
        """All measurements as JSON has them."""
        return {"matched": self.matched, "pairs": self.pairs, **self.evaluation.record()}

    def describe(self) -> str:
        """The numbers to read first, on one line."""
        parts = [
            f"{row.pictures} differ between near views by {row.edited:.3f}, unedited renders by "
            f"{row.unedited:.3f}"
            for row in self.evaluation.warp
            if row.range == "short"
        ]
        if self.rmse_to_unedited is not None:
            parts.insert(0, f"changed by {self.rmse_to_unedited:.3f} RMSE (0 is no edit)")
        if self.psnr_to_held_out_edits is not None:
            parts.append(f"{self.psnr_to_held_out_edits:.1f} dB to edits of held-out views")
        if self.psnr_to_edits_alone is not None:
            parts.append(f"{self.psnr_to_edits_alone:.1f} dB to edits of held-out views made alone")
        if self.psnr_outside_region is not None:
            edited = self.rmse_outside_region
            parts.append(
                f"outside the region {self.psnr_outside_region:.1f} dB to the unedited scene at "
                f"held-out views" + (f", RMSE {edited:.4f} at edited ones" if edited else "")
            )
        return "; ".join(parts)


SHEET_HELD_OUT_VIEWS = 2
"""Most held-out views in before_after.png."""


@dataclass(frozen=True, eq=False)
class HeldOutViews:
    """Pictures of some held-out cameras; the scene was fitted to none of them."""

    originals: tuple[View, ...] = ()
    """Renders of the unedited scene."""
    edited: tuple[View, ...] = ()
    """Pictures that a 2D diffusion model makes of the first ones, tied to the targets."""
    finals: tuple[View, ...] = ()
    """Renders of the edited scene."""
    alone: tuple[View, ...] = ()
    """Pictures of the first ones that the 2D editor makes without the targets, one by one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Measurements and pictures of an edit; without a 2D editor, what it draws is empty."""

    metrics: EditMetrics
    """The measurements of the edited scene."""
    timings: dict[str, float]
    """Seconds per stage, and in total."""
    settings: EditSettings
    """The settings, with the editor's defaults filled in."""
    held_out: HeldOutViews
    """Some cameras of which no edited picture was used."""
    originals: tuple[View, ...] = ()
    """Renders of the unedited scene at the edited views."""
    targets: tuple[View, ...] = ()
    """The edited 2D pictures that the scene was fitted to; none where the strategy edits none."""
    finals: tuple[View, ...] = ()
    """Renders of the edited scene at the edited views."""
    views: ViewList | None = None
    """Every view as it was drawn and measured; None where no 2D editor drew."""
    strategy: Any = None
    """The strategy: a record of its settings."""
    strategy_name: str = "routes"
    """The strategy's name, as in `--strategy NAME`; "routes": no view was edited."""
    view_plan: ViewPlan = field(default_factory=lambda: ViewPlan((), ()))
    """The views that were to be edited, by batch, and what they cover."""
    work: Work = field(default_factory=Work)
    """Optimizer steps, views asked of the editor, network evaluations."""
    decisions: tuple[Decision, ...] = ()
    """The decisions to skip work, with their reasons."""
    events: tuple[Event, ...] = ()
    """All events of the edit, in order."""


MAX_PROGRESS_VIEWS = 3
"""Most views that are measured while the work goes on, and by the perceptual distance at the end;
the other metrics are measured at all."""


def error_event(
    stage: str,
    seconds: float,
    decibels: float | None,
    truths: int,
    step: int = 0,
    steps: int = 0,
    loss: float | None = None,
) -> Event:
    """A mean PSNR, if there is one, as an event: to the true edit of so many held-out views, or of
    none, to the targets, which tells how far the scene follows them and not how good they are."""
    if decibels is None:
        return Event(stage, seconds, step, steps, loss)
    known = f"ground truth at {truths} held-out cameras"
    against = known if truths else "targets it is fitted to (residual)"
    note = f"{decibels:.2f} dB to the {against}"
    return Event(stage, seconds, step, steps, loss, rmse_from_psnr(decibels), note)


def measure_progress(session: Session, step: int, steps: int, loss: float | None) -> Event:
    """The error of the scene as it is now, at up to three evenly spaced views.

    Against the ground truth at held-out cameras where it is known, otherwise against the targets.
    """
    truths = true_edits(session, _few(session.request.held_out_indices))
    targets = session.progress.edited.targets
    expected = truths or {i: targets[i].image for i in _few(tuple(targets))}
    values = [psnr(preview(session, i), image) for i, image in expected.items()]
    decibels = sum(values) / len(values) if values else None
    seconds = session.progress.stopwatch.seconds
    return error_event("update", seconds, decibels, len(truths), step, steps, loss)


def true_edits(session: Session, views: Sequence[int]) -> dict[int, Float[Tensor, "h w 3"]]:
    """The true edit of these views within the region, by index; nothing where it is unknown."""
    truth = session.progress.edited.ground_truth
    if truth is None:
        return {}
    unedited = {i: session.unedited.picture(i) for i in views}
    return {i: session.within_region(i, truth(image[None])[0]) for i, image in unedited.items()}


def _few(indices: Sequence[int]) -> list[int]:
    """At most MAX_PROGRESS_VIEWS of the indices, evenly spaced."""
    return [indices[i] for i in evenly_spaced(len(indices), MAX_PROGRESS_VIEWS)] if indices else []


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing(Outcome):
    """A scene after a 2D editor drew its views, with all bands and Gaussians."""

    region: Region
    """The Gaussians that could change."""
    evidence: Evidence


def evaluate_edit(session: Session) -> Generator[Event, None, Drawing]:
    """Render the edited scene, ask the editor for held-out views, and measure.

    Yields the editor's steps, and last what the progress was measured by, over all views.
    """
    request, views = session.request, session.request.every_view
    shown = tuple(session.progress.edited.targets or session.plan.views)
    asked = request.settings.held_out_edits
    held_out = spread(request.held_out_indices, max(SHEET_HELD_OUT_VIEWS, asked))
    asked_views = held_out[:asked] if session.progress.edited.answers else ()
    answers = yield from _edit_held_out(session, asked_views)
    alone = yield from _edit_alone(session, asked_views)
    given = replace(_evaluation_input(session, shown, held_out, answers), edits_alone=alone)
    metrics = EditMetrics(evaluate(given), tuple(session.progress.edited.pairs))
    truths = len(given.ground_truth)
    final = metrics.psnr_to_ground_truth if truths else metrics.psnr_to_targets
    yield error_event("measure", session.progress.stopwatch.seconds, final, truths)
    originals = {i: session.unedited.picture(i) for i in (*shown, *held_out)}
    evidence = Evidence(
        metrics=metrics,
        timings={},
        settings=request.settings,
        held_out=HeldOutViews(
            _with_pictures(views, originals, held_out),
            _with_pictures(views, answers, answers),
            _with_pictures(views, given.finals, held_out),
            _with_pictures(views, alone, alone),
        ),
        originals=_with_pictures(views, originals, shown),
        targets=tuple(session.progress.edited.targets.values()),
        finals=_with_pictures(views, given.finals, shown),
        views=given.views,
        strategy=request.strategy,
        strategy_name=name_of(request.strategy),
        view_plan=session.plan,
        work=session.progress.work,
    )
    scene, region = given.scene, given.region or session.region
    rows = torch.arange(len(scene))
    return Drawing(scene, rows, region.inside, region=region, evidence=evidence)


def _evaluation_input(
    session: Session, shown: tuple[int, ...], held_out: tuple[int, ...], answers: Pictures
) -> EvaluationInput:
    """The edited scene rendered at edited and held-out views, and all that it is compared with."""
    request, views = session.request, session.request.every_view
    measured = tuple(dict.fromkeys((*request.held_out_indices, *held_out)))
    scene, region = session.scene.map(torch.clone), session.region
    finals = {i: render_picture(scene, views[i].camera) for i in (*shown, *measured)}
    targets = {i: view.image for i, view in session.progress.edited.targets.items()}
    return EvaluationInput(
        scene,
        _view_list(views, shown, measured),
        {**targets, **answers},
        targets_are=TARGETS_ARE,
        unedited=request.scene,
        region=region,
        max_perceptual_views=MAX_PROGRESS_VIEWS,
        quick=request.keeps_strokes,
        ground_truth=true_edits(session, request.held_out_indices),
        finals=finals,
        renderings={i: session.unedited.rendering(i) for i in finals},
    )


def _view_list(views: tuple[View, ...], edited: Iterable[int], held_out: Iterable[int]) -> ViewList:
    """The views with their roles; those that are neither edited nor measured are neighbors."""
    roles: dict[int, Role] = {i: "held_out" for i in held_out}
    roles.update((i, "edited") for i in edited)
    viewpoints = tuple(Viewpoint(view.name, view.camera) for view in views)
    return ViewList(viewpoints, tuple(roles.get(i, "other") for i in range(len(views))))


def _with_pictures(
    views: tuple[View, ...], pictures: Pictures, indices: Iterable[int]
) -> tuple[View, ...]:
    """The views with these indices, showing these pictures."""
    return tuple(replace(views[i], image=pictures[i]) for i in indices)


def _edit_held_out(
    session: Session, views: tuple[int, ...]
) -> Generator[Event, None, Mapping[int, Float[Tensor, "h w 3"]]]:
    """Ask the editor for these held-out views as it was asked for the targets.

    They are tied to targets by anchors and the noise that all batches share. Nothing is asked where
    that has no meaning: the editor is no diffusion model, so it has no noise to share. Sampling
    starts from the unedited scene: the answers must not depend on the edited scene, which is
    compared with them.
    """
    answers, editor = session.progress.edited.answers, session.request.editor
    if not views or editor.capabilities.denoiser is None:
        return {}
    cameras = [view.camera for view in session.request.every_view]
    unedited = UneditedViews(cameras, session.unedited.rendering)
    near = zip(*(unedited.nearest(view, answers) for view in views))  # in turn, a view at a time
    nearest = tuple(dict.fromkeys(chain.from_iterable(near)))
    anchors = nearest[: session.request.settings.anchors]
    members = (*views, *anchors)
    images = yield from sample_views(
        session,
        members,
        anchors,
        match_views(session, members),
        session.request.settings.sampler,
        start={i: session.unedited.picture(i) for i in views},
        stage=MEASURE,
    )
    return {i: session.target(i, image) for i, image in zip(views, images)}


def _edit_alone(
    session: Session, views: tuple[int, ...]
) -> Generator[Event, None, Mapping[int, Float[Tensor, "h w 3"]]]:
    """Ask the editor for each of these views on its own, in a batch of its own: no anchor, nothing
    shared, not harmonised. What the targets agree on does not help these pictures."""
    alone, sampler = {}, session.request.settings.sampler
    for i in views:
        start = {i: session.unedited.picture(i)}
        (image,) = yield from sample_views(session, (i,), (), None, sampler, start, MEASURE)
        alone[i] = session.target(i, image)
    return alone
