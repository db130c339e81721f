"""A large scene is drawn by groups: of neighbors that are smaller than the pixels one, and each has
its share of the change. Under strokes, Gaussians that are larger are drawn in pieces."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import torch

from gsedit.capture.fitting.densify import divided
from gsedit.editing.measure import Changed, means_of, of_the_whole, pictures_at
from gsedit.paper.draw import EditPlan, draw, explain
from gsedit.paper.evaluate import Drawing
from gsedit.paper.request import Request, fits_pictures
from gsedit.paper.session import edit_camera
from gsedit.paper.skips import DISABLED, Decision, one_line
from gsedit.paper.view_plan import survey
from gsedit.run.events import Checkpoint, Event
from gsedit.run.state import State
from gsedit.scene.framing import finest_pixels
from gsedit.scene.merging import MAX_GAUSSIANS, MergedScene, coarsen
from gsedit.views.dataset import evenly_spaced

MEASURED_VIEWS = 4
"""Held-out views at which a large scene is measured: its renders take seconds."""


def drawn(
    request: Request, resume: State | None = None
) -> Generator[Event | Checkpoint, None, Drawing]:
    """Draw a request as `draw` does; of a large scene its groups. The drawing has all Gaussians, or
    the pieces of those that strokes are finer than."""
    merged, few = _by_groups(request)
    if merged is None and request.keeps_strokes:
        return (yield from _in_pieces(request, resume))
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
        yield _of_all(item, merged)
    evidence = drawing.evidence
    told = (decision, *evidence.decisions)
    evidence = replace(evidence, decisions=told, events=(*events, *evidence.events))
    drawing = replace(drawing, evidence=evidence)
    return drawing if merged is None else _carried(drawing, request, merged)


PIECE = 1.0
"""Standard deviation, in pixels of what is drawn, to which Gaussians are divided under strokes."""
MOST_TIMES = 8
"""Times as many Gaussians as before that there are at most then, and never over MAX_GAUSSIANS."""


def _in_pieces(
    request: Request, resume: State | None
) -> Generator[Event | Checkpoint, None, Drawing]:
    """Draw strokes on a scene whose Gaussians are divided where strokes are finer."""
    before, region, size = request.scene, request.region, request.settings.edit_size
    cameras = [edit_camera(view.camera, size) for view in request.views]
    worth = survey(before, cameras).amax(0) * (1.0 if region is None else region.inside)
    finest = PIECE * finest_pixels(before.means, cameras)
    most = min(MAX_GAUSSIANS, MOST_TIMES * len(before))
    pieces, origin = divided(before, finest, worth, most)
    if region is not None:
        region = replace(region, inside=region.inside[origin])
    drawing = yield from draw(replace(request, scene=pieces, region=region), resume)
    evidence = of_the_whole(drawing.evidence, before, drawing.scene)
    told = f"{len(before):,} Gaussians are {len(pieces):,} now: strokes are finer than some were"
    notes = (*drawing.notes, *[told] * (len(pieces) > len(before)))
    return replace(drawing, origin=origin, notes=notes, evidence=evidence)


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
    return merged, replace(request, scene=merged.scene, region=region)


def _of_all(item: Event | Checkpoint, merged: MergedScene | None) -> Event | Checkpoint:
    """An event, or a checkpoint whose scene has all Gaussians."""
    if merged is None or isinstance(item, Event):
        return item
    groups = item.copy_scene
    return replace(item, copy_scene=lambda: merged.transfer(groups()))


def _carried(drawing: Drawing, request: Request, merged: MergedScene) -> Drawing:
    """A drawing of groups, carried to all Gaussians, with renders and means of these."""
    before, after = request.scene, merged.transfer(drawing.scene)
    region = replace(drawing.region, inside=merged.expand(drawing.region.inside))
    evidence = of_the_whole(drawing.evidence, before, after)
    few = [request.held_out[i] for i in evenly_spaced(len(request.held_out), MEASURED_VIEWS)]
    originals = (*evidence.originals, *pictures_at(before, few))
    finals = (*evidence.finals, *pictures_at(after, few))
    edited = len(evidence.originals)
    means = means_of(before, Changed(after, region), originals, finals, edited)
    evidence = replace(evidence, metrics=evidence.metrics.with_means(means))
    rows = torch.arange(len(after))
    return Drawing(after, rows, region.inside, drawing.notes, region=region, evidence=evidence)


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
