"""What an edit leaves out, decision by decision."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.depth_maps import DEFAULT_RULES
from gsedit.fitting.optimiser import SH_REST
from gsedit.fitting.random_crops import crops_needed, share_of_crops
from gsedit.fitting.update import APPEARANCE_RATES, rate_scale
from gsedit.savings.bands import adam_travel, band_colours, decide_bands
from gsedit.savings.decision import Decision
from gsedit.savings.fields import decide_densification, decide_geometry
from gsedit.savings.gaussians import decide_cells, decide_gaussians
from gsedit.savings.pictures import (
    decide_crops,
    decide_depth,
    decide_pairs,
    decide_resolution,
    decide_views,
)
from gsedit.session.actions import Action, OptimiserSteps
from gsedit.session.session import Session
from gsedit.session.settings import EditSettings
from gsedit.views.plan import view_overlap
from rasterizer.numerics import SH_DC


@torch.no_grad()
def decide(session: Session, schedule: Iterator[Action]) -> tuple[Decision, ...]:
    """Every decision of this edit, whose strategy has that schedule; none without a plan.

    Nothing is decided here that the session does not do already. Of the session, only the renders
    of the region that it keeps become more.
    """
    settings = session.settings
    if not settings.plan:
        return ()
    decisions = (*_of_the_scene(session, schedule), *_of_pictures(session), decide_densification())
    return tuple(_as_asked(decision, settings) for decision in decisions)


def _of_the_scene(session: Session, schedule: Iterator[Action]) -> Iterator[Decision]:
    """What of the Gaussians is left out."""
    reduction, settings = session.surveyed.reduction, session.settings
    coefficients = session.request.scene.sh.shape[1]
    yield decide_cells(len(session.request.whole), len(session.request.scene))
    yield _gaussians(session)
    travel = adam_travel(_band_rates(schedule))
    yield decide_bands(reduction.scene.sh, ~reduction.left, coefficients, travel)
    yield decide_geometry(settings.geometry == "appearance", coefficients)


def _of_pictures(session: Session) -> Iterator[Decision]:
    """What of the views is left out."""
    settings, surveyed, views = session.settings, session.surveyed, session.request.views
    plan, reduction, camera = surveyed.plan, surveyed.reduction, views[0].camera
    budget = min(settings.rounds * settings.views_per_round, len(views))
    if session.request.all_views:
        yield Decision("views", False, "Needed: the strategy edits or renders all of them")
    else:
        yield decide_views(len(plan.views), budget, plan.coverage[-1], settings.coverage)
    size = (camera.width, camera.height)
    yield decide_resolution(reduction.full, size, reduction.footprint, reduction.lost)
    yield decide_depth()
    rows = surveyed.weights[list(plan.views)]
    overlap = view_overlap(rows, rows)
    rules = DEFAULT_RULES if settings.visibility else None
    yield decide_pairs(overlap, rules)
    known, patches = session.edited.region is not None, settings.update.patches
    touching = _touching(session)
    yield decide_crops(known, touching, patches, crops_needed(patches, touching))


def _as_asked(decision: Decision, settings: EditSettings) -> Decision:
    """The decision, or that its work is done anyway."""
    if settings.leaves_out(decision.name):
        return decision
    return Decision(decision.name, False, "Not decided: --do-anyway names it")


def _gaussians(session: Session) -> Decision:
    """The Gaussians that the update leaves alone, and how much of the planned views they are."""
    reduction, renderings = session.surveyed.reduction, session.surveyed.renderings
    shown = session.surveyed.weights[list(session.surveyed.plan.views)]
    marked = [renderings[i].marked for i in session.surveyed.plan.views]
    maps = [mark.flatten() for mark in marked if mark is not None]
    covered = torch.stack(maps) if maps else torch.zeros(len(shown), 1)
    sh = reduction.scene.sh
    highest = 0.5 + SH_DC * sh[:, 0].amax(-1) + band_colours(sh).sum(-1)
    return decide_gaussians(reduction.left, shown, covered, max(1.0, float(highest.max())))


def _band_rates(schedule: Iterator[Action]) -> Float[Tensor, " t"]:
    """The learning rate of view-dependent colour in every step of the schedule."""
    scales = [
        rate_scale(step, action.round_steps)
        for action in schedule
        if isinstance(action, OptimiserSteps)
        for step in range(action.first, action.last)
    ]
    return APPEARANCE_RATES["sh"] * SH_REST * torch.tensor(scales, dtype=torch.float64)


def _touching(session: Session) -> float:
    """The share of crops of the planned views in which the region shows, as far as it is known."""
    shown = session.shown(session.surveyed.plan.views)
    return 1.0 if shown is None else share_of_crops(shown, session.settings.update.patch)
