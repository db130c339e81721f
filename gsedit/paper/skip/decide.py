"""The decisions of an edit: is the scene merged, which views, crops and Gaussians are skipped.

`n` Gaussians, `v` views of `p` pixels.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.fitting.random_crops import crops_needed, share_of_crops
from gsedit.paper.session import Session, region_masks
from gsedit.paper.skip.decision import Bound, Decision, DecisionName, Skipped
from gsedit.paper.skip.invisible import FAINT_SHARE, band_colors
from gsedit.paper.strategy import uses_all_views
from rasterizer.numerics import SH_DC


@torch.no_grad()
def explain_skips(session: Session) -> tuple[Decision, ...]:
    """Every decision of this edit, with its reason, its saving and its bound.

    Nothing is decided here that the session does not do already.
    """
    request, surveyed, settings = session.request, session.surveyed, session.request.settings
    planned, update = surveyed.plan.views, settings.update
    masks = region_masks(session, planned)
    touching = 1.0 if masks is None else share_of_crops(masks, update.patch)
    needed = crops_needed(update.patches, touching)
    is_known = session.progress.edited.region is not None
    budget = min(settings.batches * settings.views_per_batch, len(request.views))
    marked = [surveyed.renderings[i].marked for i in planned]
    maps = [mark.flatten() for mark in marked if mark is not None]
    covered = torch.stack(maps) if maps else torch.zeros(len(planned), 1)
    shares = surveyed.weights[list(planned)]
    decisions = (
        decide_merging(len(request.whole), len(request.scene)),
        decide_views(
            len(planned),
            budget,
            surveyed.plan.coverage[-1],
            settings.coverage,
            needs_all=uses_all_views(request.strategy),
        ),
        NO_CROPS if request.solves else decide_crops(is_known, touching, update.patches, needed),
        NO_STEPS
        if request.solves
        else decide_gaussians(surveyed.faint, shares, covered, surveyed.scene.sh),
    )
    return tuple(
        decision if settings.skips(decision.name) else disabled(decision.name)
        for decision in decisions
    )


NO_CROPS = Decision("crops", False, "Needed: colors are solved for from whole views")
NO_STEPS = Decision("gaussians", False, "Needed: what no edited view sees follows the others")
DISABLED = "Not decided: --disable names it"


def decide_merging(gaussians: int, groups: int) -> Decision:
    """Whether the Gaussians of a large scene are edited as so many `groups`."""
    if groups == gaussians:
        return Decision("merging", False, "Needed: a scene of so few Gaussians is edited as it is")
    return Decision(
        "merging",
        True,
        "Most are smaller than the pixels of the edit: neighbors are surveyed and fitted together "
        "as one, and each takes its share of the change. The error was measured "
        "(docs/measurements/scale.md), it has no proven bound",
        Skipped(gaussians - groups, gaussians, "Gaussians"),
        1 - groups / gaussians,
        "the Gaussians of the survey and the update",
    )


def decide_views(
    edited: int, budget: int, coverage: float, wanted: float, *, needs_all: bool
) -> Decision:
    """Whether views of the `budget` are not edited, since the `edited` ones cover enough.

    `needs_all`: the strategy edits or renders all views.

    A Gaussian that is not covered may keep any color. Together these carry 1 - coverage of all
    blending weights of all views, and so of all pixels.
    """
    if needs_all:
        return Decision("views", False, "Needed: the strategy edits or renders all of them")
    if edited == budget:
        reason = f"{edited} views cover {coverage:.0%}, {wanted:.0%} are wanted"
        return Decision("views", False, f"Needed: {reason}")
    return Decision(
        "views",
        True,
        f"{edited} views show well {coverage:.1%} of what all show",
        Skipped(budget - edited, budget, "views that may be edited"),
        1 - edited / budget,
        "the editing and the update",
        Bound(1 - coverage, "of a pixel's color, mean over the pixels of all views"),
    )


def decide_crops(known: bool, touching: float, patches: int, needed: int) -> Decision:
    """Whether the update draws no crops in which the region, if it is `known`, does not show.

    `touching` is the share of all crops in which it shows; `needed` of `patches` crops a step are
    as many as show it on average, rounded up. Where the region is less than 1 / 255 of a pixel, no
    color of it changes the pixel by more.
    """
    if not known:
        return Decision("crops", False, "The region is known once views are edited: decided then")
    if touching >= 1:
        return Decision("crops", False, "Needed: what may change shows in every crop")
    more = "" if needed < patches else "; a step still draws as many, all of them useful"
    return Decision(
        "crops",
        True,
        f"The region shows in {touching:.0%} of all crops: only these are drawn{more}",
        Skipped(patches - needed, patches, "crops a step") if needed < patches else None,
        1 - needed / patches,
        "the crops of the update",
        Bound(1 / 255, "of the color of a pixel in the other crops"),
    )


def decide_gaussians(
    faint: Bool[Tensor, " n"],
    shares: Float[Tensor, "v n"],
    covered: Float[Tensor, "v p"],
    sh: Float[Tensor, "n k 3"],
) -> Decision:
    """Whether the update does not move the `faint` Gaussians of the scene with colors `sh`.

    `covered`: the sum of their blending weights at each pixel, W. Without them those behind show
    through: their weights, and the background's, grow by W in total, since all weights of a pixel
    add up to 1. So the pixel changes by at most W times the largest color.
    """
    number = int(faint.sum())
    if not number:
        return Decision("gaussians", False, "Needed: the edited views show every Gaussian")
    highest = 0.5 + SH_DC * sh[:, 0].amax(-1) + band_colors(sh).sum(-1)
    brightest = max(1.0, float(highest.max()))
    unseen = int((shares[:, faint].amax(0) == 0).sum())
    error = float(covered.double().square().mean(1).amax().sqrt()) * brightest
    return Decision(
        "gaussians",
        True,
        f"No edited view sees {unseen:,} of them, and the others carry at most {FAINT_SHARE:.2%} "
        "of a picture together: the update does not move them",
        Skipped(number, len(faint), "Gaussians"),
        number / len(faint),
        "the Gaussians of the update",
        Bound(error, "RMSE of an edited view"),
    )


def disabled(name: DecisionName) -> Decision:
    """The decision of an edit whose settings disable this kind of skipping."""
    return Decision(name, False, DISABLED)
