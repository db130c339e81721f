"""A large scene is drawn by groups: of neighbors that are smaller than the pixels one, and each has
its share of the change. Under strokes, Gaussians that are larger are drawn in pieces."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.capture.fitting.densify import divided
from gsedit.capture.fitting.strokes import leading_views
from gsedit.editing.measure import Changed, means_of, of_the_whole, pictures_at
from gsedit.paper.draw import EditPlan, draw, explain
from gsedit.paper.evaluate import Drawing
from gsedit.paper.request import Request, fits_pictures
from gsedit.paper.session import edit_camera
from gsedit.paper.skips import DISABLED, Decision, one_line
from gsedit.paper.view_plan import survey
from gsedit.run.events import Checkpoint, Event
from gsedit.run.state import State
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.framing import finest_pixels
from gsedit.scene.merging import MAX_GAUSSIANS, MergedScene, coarsen
from gsedit.select.region import everything
from gsedit.views.dataset import evenly_spaced
from rasterizer.scene import Gaussians

MEASURED_VIEWS = 4
"""Held-out views at which the whole scene is measured: renders of a large one take seconds."""


def drawn(
    request: Request, resume: State | None, watch: Stopwatch
) -> Generator[Event | Checkpoint, None, Drawing]:
    """Draw a request as `draw` does; of a large scene its groups. The drawing has all Gaussians, or
    the pieces of those that strokes are finer than."""
    origin, worth = None, None
    with watch.stage("divide"):
        merged, few = _by_groups(request)
        if merged is None and request.keeps_strokes:
            few, origin, worth = _in_pieces(request, resume)
    decision, events = _decide(request, merged), ()
    if merged is not None:
        events = (Event("skip", 0.0, note=one_line((decision,))),)
        yield from events if resume is None else ()
    work = draw(few, resume)
    while True:
        try:
            item = next(work)
        except StopIteration as ended:
            drawing: Drawing = ended.value
            break
        if few is not request and isinstance(item, Checkpoint):
            item = _of_all(item, merged, few.scene, worth)
        yield item
    evidence = drawing.evidence
    told = (decision, *evidence.decisions)
    evidence = replace(evidence, decisions=told, events=(*events, *evidence.events))
    drawing = replace(drawing, evidence=evidence)
    with watch.stage("measure"):
        return _carried(drawing, request, merged, origin)


MOST_TIMES = 8
"""Times as many Gaussians as before that there are at most then, and never over MAX_GAUSSIANS."""


def _in_pieces(
    request: Request, resume: State | None
) -> tuple[Request, Int[Tensor, " m"], Float[Tensor, " n"]]:
    """The request to draw on a scene whose Gaussians are divided where strokes are finer (standard
    deviation: a pixel of what is drawn), the row before of each piece, and what each Gaussian was
    worth: a checkpoint holds it, since the order of pieces depends on how renders are rounded."""
    before, region, size = request.scene, request.region, request.settings.edit_size
    cameras = [edit_camera(view.camera, size) for view in request.views]
    seen = survey(before, cameras)
    worth = seen.amax(0) * (1.0 if region is None else region.inside)
    held = worth if resume is None else resume.tensors.get("worth", worth)
    worth = held if held.shape == worth.shape else worth  # which another scene's is not
    finest = finest_pixels(before.means, cameras)
    pieces, origin = divided(before, finest, worth, min(MAX_GAUSSIANS, MOST_TIMES * len(before)))
    leading = leading_views(seen if region is None else seen * region.inside, before.means)[origin]
    if region is not None:
        region = replace(region, inside=region.inside[origin])
    shares = seen[:, origin] / origin.bincount()[origin]  # each piece has an equal one
    few = replace(request, scene=pieces, region=region, seen=shares, leading=leading)
    return few, origin, worth


def explained(request: Request) -> EditPlan:
    """Plan a drawing as `explain` does, of a large scene that of its groups."""
    merged, few = _by_groups(request)
    plan = explain(few)
    return plan._replace(decisions=(_decide(request, merged), *plan.decisions))


def _by_groups(request: Request) -> tuple[MergedScene | None, Request]:
    """The groups of a large scene, and the request to draw them; None, and the request itself where
    its Gaussians are drawn one by one."""
    settings, merged = request.settings, None
    colors = settings.geometry == "appearance" and fits_pictures(request.strategy)
    if colors and settings.skips("merging"):
        merged = coarsen(request.scene, cameras=[view.camera for view in request.every_view])
    if merged is None:
        return None, request
    region = request.region
    if region is not None:
        region = replace(region, inside=merged.majority(region.inside))
    return merged, replace(request, scene=merged.scene, region=region, whole=request.scene)


def _of_all(
    item: Checkpoint, merged: MergedScene | None, drawn: Gaussians, worth: Tensor | None
) -> Checkpoint:
    """A checkpoint whose scene has all Gaussians; that of pieces holds what does not move too."""
    if merged is not None:
        groups = item.copy_scene
        return replace(item, copy_scene=lambda: merged.transfer(groups()))
    still = {f"optimizer.value.{name}": value for name, value in vars(drawn).items()}
    still["worth"] = worth
    return replace(item, state=replace(item.state, tensors={**still, **item.state.tensors}))


def _carried(
    drawing: Drawing, request: Request, merged: MergedScene | None, origin: Tensor | None
) -> Drawing:
    """A drawing of groups, carried to all Gaussians, or of pieces, with renders and means that
    compare it with the whole scene before."""
    if merged is None and origin is None:
        return drawing
    before, after, region, notes = request.scene, drawing.scene, drawing.region, drawing.notes
    if merged is not None:
        after = merged.transfer(drawing.scene)
        region = replace(region, inside=merged.expand(region.inside))
    elif len(after) > len(before):
        told = f"{len(before):,} Gaussians are {len(after):,} now: strokes are finer than some were"
        notes = (*notes, told)
    evidence = of_the_whole(drawing.evidence, before, after if merged else None)
    few = [request.held_out[i] for i in evenly_spaced(len(request.held_out), MEASURED_VIEWS)]
    originals = (*evidence.originals, *pictures_at(before, few))
    finals = (*evidence.finals, *pictures_at(after, few))
    own = None if merged else request.region or everything(before)
    changed = Changed(after, region, region_before=own)
    means = means_of(before, changed, originals, finals, len(evidence.originals))
    evidence = replace(evidence, metrics=evidence.metrics.with_means(means))
    rows = torch.arange(len(after)) if origin is None else origin
    return Drawing(after, rows, region.inside, notes, region=region, evidence=evidence)


def _decide(request: Request, merged: MergedScene | None) -> Decision:
    """Whether the Gaussians of a scene are drawn as groups, and why."""
    if not request.settings.skips("merging"):
        return Decision("merging", False, DISABLED)
    if merged is None:
        return Decision("merging", False, "Needed: a scene of so few Gaussians is edited as it is")
    gaussians, groups = len(request.scene), len(merged.scene)
    return Decision(
        "merging",
        True,
        "Most are smaller than the pixels of the edit: neighbors are surveyed and fitted together "
        "as one, and each takes its share of the change. The error was measured "
        "(docs/measurements/scale.md), it has no proven bound",
        f"{gaussians - groups:,} of {gaussians:,} Gaussians",
        1 - groups / gaussians,
        "the Gaussians of the survey and the update",
    )
