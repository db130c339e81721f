"""Ask the 2D editor for a batch of views that agree with each other and with the finished ones."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter
from torch import Tensor

from gsedit.errors import GseditError
from gsedit.paper.consistency.correspond import Correspondences, correspond
from gsedit.paper.consistency.harmonise import Surface, harmonise_by_depth
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.protocol import EditBatch, Places, StylePainter, truth_of
from gsedit.paper.guided import carry_change
from gsedit.paper.session import Session, UneditedRenders, preview
from gsedit.paper.view_plan import view_overlap
from gsedit.run.events import Event
from gsedit.select.region import (
    MIN_SEEN_PIXELS,
    Lifted,
    Region,
    coverage,
    everything,
    lift,
    otsu,
    smoothed,
)
from gsedit.select.surfaces import neighbors
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.depth_maps import DEFAULT_RULES
from gsedit.views.image_ops import downscale, pad_camera, pad_to_multiple
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

MAX_OUTSIDE_SHARE = 0.25
"""Largest change outside, as a share of that inside: editors change surroundings a little."""


def find_changed(scene: Gaussians, lifted: Lifted) -> Bool[Tensor, " n"] | None:
    """Find the Gaussians that an edit changes, from the lifted size of the change.

    None where that is everything: outside, the change must be at most `MAX_OUTSIDE_SHARE` of that
    inside.
    """
    graph = neighbors(scene)
    scale = (
        float(lifted.mean[lifted.weight > MIN_SEEN_PIXELS].quantile(0.95)) if len(scene) else 0.0
    )
    if scale <= 0:
        return None
    values = smoothed(replace(lifted, mean=lifted.mean / scale), graph)
    inside = values > otsu(values, lifted.weight)
    means = [
        float((lifted.weight * values)[part].sum() / lifted.weight[part].sum().clamp_min(1e-9))
        for part in (inside, ~inside)
    ]
    return inside if means[1] < MAX_OUTSIDE_SHARE * means[0] else None


def vote_region(
    scene: Gaussians,
    cameras: Sequence[Camera],
    edited: Mapping[int, Float[Tensor, "h w 3"]],
    originals: Mapping[int, Float[Tensor, "h w 3"]],
) -> Region:
    """The region that the editor changed, voted over the edited views.

    `cameras` are those of all views; `edited` and `originals` are pictures by index.
    """
    # the root mean square over the channels
    changes = [(image - originals[i]).square().mean(-1).sqrt() for i, image in edited.items()]
    lifted = lift(scene, [cameras[i] for i in edited], changes)
    inside = find_changed(scene, lifted)
    if inside is None:
        return Region(everything(scene).inside, "auto: the edit is of the whole scene")
    return Region(inside, "auto: what the edit changes")


MEASURE = "measure"
"""The stage in which the editor is asked for views to compare the result with."""
MIN_ANCHOR_OVERLAP = 0.3
"""Least overlap of a further anchor with the new views: below it few cells match (0.12 of them on
the bear), and a view's cells are compared for nothing."""


def edit_views(
    session: Session,
    batch: Sequence[int],
    *,
    step: int = 0,
    steps: int = 0,
    sampler: SamplerSettings | None = None,
) -> Iterator[Event]:
    """Edit the views with these indices together, tied to finished ones by the settings' anchors.

    This is batch `step` of `steps`. `sampler` overrules the settings'. The targets, pairs, region
    and ground truth of the progress are brought up to date.
    """
    settings = session.request.settings
    sampler, anchors = sampler or settings.sampler, settings.anchors
    edited, stopwatch = session.progress.edited, session.progress.stopwatch
    tied, matches = (), None
    if not isinstance(session.request.editor, StylePainter):
        tied = choose_anchors(session.weights, batch, tuple(edited.targets))[:anchors]
        with stopwatch.stage("correspond"):
            matches = match_views(session, (*batch, *tied))
        names = [session.request.every_view[i].name for i in (*batch, *tied)]
        ends = tuple(itertools.combinations(range(len(names)), 2))
        shares = [float(matches.matched[pair]) for pair in ends]
        edited.pairs += [(names[a], names[b], share) for (a, b), share in zip(ends, shares)]
        note = _describe(matches, shares)
        yield Event("correspond", stopwatch.seconds, step, steps, note=note)
    members = (*batch, *tied)
    with stopwatch.stage("sample"):
        images = yield from sample_views(session, members, tied, matches, sampler)
    yield from _accept(session, dict(zip(batch, images)), step, steps)


def edit_alone(
    session: Session, view: int, sampler: SamplerSettings, *, step: int = 0, steps: int = 0
) -> Iterator[Event]:
    """Edit the view with this index on its own: with noise of its own, tied to no other view.

    This is edit `step` of `steps`. The targets, region and ground truth of the progress are brought
    up to date.
    """
    with session.progress.stopwatch.stage("sample"):
        images = yield from sample_views(session, (view,), (), None, sampler)
    yield from _accept(session, {view: images[0]}, step, steps)


def _accept(
    session: Session, answers: Mapping[int, Float[Tensor, "h w 3"]], step: int, steps: int
) -> Iterator[Event]:
    """Make the editor's pictures of these views their targets, within the region."""
    request, edited = session.request, session.progress.edited
    stopwatch, views = session.progress.stopwatch, session.request.every_view
    edited.answers |= answers
    with stopwatch.stage("region"):
        first = edited.region is None
        if first:
            originals = {i: session.unedited.condition(i) for i in edited.answers}
            cameras = [view.camera for view in views]
            edited.region = vote_region(request.scene, cameras, edited.answers, originals)
            edited.voted = True
            yield Event("region", stopwatch.seconds, step, steps, note=str(edited.region))
        for i in edited.answers if first else answers:  # earlier ones had no region yet
            image = session.target(i, edited.answers[i])
            edited.targets[i] = View(views[i].name, views[i].camera, image)
    find_ground_truth(session, edited.answers)


def sample_views(
    session: Session,
    members: Sequence[int],
    anchors: Sequence[int],
    matches: Correspondences | None,
    sampler: SamplerSettings,
    start: Mapping[int, Float[Tensor, "h w 3"]] | None = None,
    stage: str = "sample",
) -> Generator[Event, None, list[Float[Tensor, "h w 3"]]]:
    """Ask the 2D editor for pictures of `members` but `anchors`, which stay as they were edited.

    Without `matches` every view is edited on its own. Sampling begins at `start`, or where the
    scene is now. Everything that a target goes through belongs here: held-out views are asked for
    in the same way. Views are edited at the editor's size, and their change is carried to their
    own. Yields events of the `stage`; returns pictures in [0, 1].
    """
    request, progress, editor = session.request, session.progress, session.request.editor
    batch = batch_of(session, members, anchors, matches, start)
    images, evaluations = None, 0
    for each in editor.edit(batch, sampler, request.generator):
        seconds = progress.stopwatch.seconds
        yield Event(stage, seconds, each.step, each.steps)
        images, evaluations = each.images, each.evaluations
    if stage != MEASURE:  # what the result is compared with is no cost of the edit
        progress.work.calls += len(members) - len(anchors)
        progress.work.evaluations += evaluations
    if images is None:
        raise RuntimeError(f"editor {request.editor.name} ended without images")
    names = [request.every_view[i].name for i in members]
    images = validate_edited_images(images, batch.originals, names)
    if matches and sampler.consensus and sampler.harmonise:
        images = _harmonised(session.unedited, members, images, batch.anchored)
    sampled = []
    for i, image, original in zip(members, images, batch.originals):
        if i not in anchors:
            full = session.unedited.condition(i)
            sampled.append(carry_change(image[None].to(full), original[None].to(full), full[None]))
    return [each[0] for each in sampled]


def find_ground_truth(session: Session, edited: Mapping[int, Float[Tensor, "h w 3"]]) -> None:
    """Find the true edit that these pictures of views show, where the editor has one."""
    known = truth_of(session.request.editor)
    if known is not None:
        images = torch.stack(list(edited.values()))
        originals = torch.stack([session.unedited.condition(i) for i in edited])
        session.progress.edited.ground_truth = known.find_ground_truth(
            session.request.prompt, images, originals
        )


def match_views(session: Session, members: Sequence[int]) -> Correspondences:
    """Match latent cells of these views that show the same place, by the unedited scene's depth."""
    unedited, cell = session.unedited, session.request.editor.cell
    alphas = [unedited.edit_rendering(i).alpha for i in members]
    # up to whole cells nothing is seen: alpha 0
    return correspond(
        [pad_camera(unedited.edit_camera(i), cell) for i in members],
        pad_to_multiple(_depths(session, members), cell, "constant"),
        pad_to_multiple(torch.stack(alphas), cell, "constant"),
        cell=cell,
        rules=DEFAULT_RULES,
    )


def _depths(session: Session, members: Sequence[int]) -> Float[Tensor, "v h w"]:
    """Median depths of the unedited scene at the size at which these views are edited."""
    renderings = (session.unedited.edit_rendering(i) for i in members)
    return torch.stack([r.median_depth for r in renderings if r.median_depth is not None])


EYES = 32
"""Cameras by whose mean distance sizes of pixels are told."""


def _places(session: Session, members: Sequence[int]) -> Places:
    """Places of the pixels of these views, at the size at which they are edited."""
    unedited, depths, points = session.unedited, list[Tensor](), list[Tensor]()
    few = evenly_spaced(len(session.request.every_view), EYES)
    cameras = [unedited.edit_camera(i) for i in few]
    eyes = torch.stack([each.center for each in cameras])
    focal = sum(each.fx for each in cameras) / len(cameras)  # one, whatever the view's own lens
    for i, depth in zip(members, _depths(session, members)):
        camera = unedited.edit_camera(i)
        seen = torch.where(depth > 0, depth, depth.max()).clamp_min(1e-6)
        depths.append(torch.from_numpy(median_filter(seen.numpy(), 5)))
        at = camera.unproject(camera.pixel_centers(), depths[-1].double())
        away = torch.cdist(at.flatten(0, 1), eyes.to(at)).mean(-1).unflatten(0, depth.shape)
        points.append((at - eyes.mean(0)) * (focal / away)[..., None])
    ups = torch.stack([-each.rotation[1] for each in cameras])
    up = ups.mean(0) + 1e-6 * ups[0]  # its own where they cancel
    return Places(torch.stack(depths), torch.stack(points), up, unedited.tones)


def _harmonised(
    unedited: UneditedRenders,
    members: Sequence[int],
    images: Float[Tensor, "v h w 3"],
    anchored: Bool[Tensor, " v"] | None,
) -> Float[Tensor, "v h w 3"]:
    """The editor's pictures of these views, their coarse colors brought to agreement."""
    surfaces = []
    for i in members:
        rendering = unedited.edit_rendering(i)
        assert rendering.median_depth is not None
        camera, color = unedited.edit_camera(i), rendering.color.clamp(0, 1)
        surfaces.append(Surface(camera, rendering.median_depth, rendering.alpha, color))
    return harmonise_by_depth(images, surfaces, anchored=anchored)


def batch_of(
    session: Session,
    members: Sequence[int],
    anchors: Sequence[int] = (),
    matches: Correspondences | None = None,
    start: Mapping[int, Float[Tensor, "h w 3"]] | None = None,
) -> EditBatch:
    """The batch that the editor is given: new views at `start` (None: current renders), and anchors
    as they were edited; all at the size at which they are edited."""
    request, unedited = session.request, session.unedited
    answers = session.progress.edited.answers
    cameras = {i: unedited.edit_camera(i) for i in members}
    new = [i for i in members if i not in anchors]
    start = start or {i: preview(session, i, cameras[i]) for i in new}
    originals = {i: unedited.edit_condition(i) for i in members}
    images = [
        _at_edit_size(answers[i], unedited.condition(i), originals[i])
        if i in anchors
        else downscale(start[i], cameras[i].width, cameras[i].height).clamp(0, 1)  # rounding
        for i in members
    ]
    return EditBatch(
        images=torch.stack(images),
        originals=torch.stack(list(originals.values())),
        prompt=request.prompt,
        correspondences=matches,
        anchored=torch.tensor([i in anchors for i in members]),
        subject=_subject(session, [cameras[i] for i in members]),
        seed=session.progress.noise_seed,
        places=_places(session, members) if request.rules else None,
    )


def _subject(session: Session, cameras: Sequence[Camera]) -> Float[Tensor, "v h w"] | None:
    """The region in pictures of the unedited scene, for editors that take it as a mask; None where
    the editor decides: the region is everything, or comes from its edits."""
    if session.region.is_all or session.progress.edited.voted:
        return None
    scene = session.request.scene
    return torch.stack([coverage(session.region, scene, c) for c in cameras])


def _at_edit_size(
    answer: Float[Tensor, "h w 3"], own: Float[Tensor, "h w 3"], original: Float[Tensor, "y x 3"]
) -> Float[Tensor, "y x 3"]:
    """An edited view at the size of the unedited picture that the editor is shown.

    `own`: the unedited picture at the view's size. Enlarged, the answer keeps the picture's detail.
    """
    height, width = original.shape[:2]
    if width > answer.shape[1]:
        return carry_change(answer[None], own[None], original[None])[0]
    return downscale(answer, width, height).clamp(0, 1)


def choose_anchors(
    weights: Float[Tensor, "v n"], batch: Sequence[int], edited: Sequence[int]
) -> tuple[int, ...]:
    """The `edited` views that the views of the batch overlap with, the most first.

    The best one is always among them; others where their overlap is at least `MIN_ANCHOR_OVERLAP`
    on average. `weights` are those of the survey.
    """
    finished = [i for i in edited if i not in batch]
    if not finished:
        return ()
    common = view_overlap(weights[finished], weights[list(batch)]).mean(1)
    order = common.argsort(descending=True, stable=True).tolist()
    return tuple(finished[i] for i in order if i == order[0] or common[i] >= MIN_ANCHOR_OVERLAP)


def _describe(matches: Correspondences, shares: Sequence[float]) -> str:
    """A sentence on how much the views of a batch have in common, with the `shares` of pairs."""
    if not shares:
        return "one view: there is no other to agree with"
    mean = sum(shares) / len(shares)
    warning = "; the views see little of each other" if mean < 0.05 else ""
    return (
        f"{mean:.0%} of cells matched per pair ({min(shares):.0%} to {max(shares):.0%}), "
        f"{matches.covered.mean():.0%} in a cluster{warning}"
    )


def validate_edited_images(
    images: Float[Tensor, "v y x c"], originals: Float[Tensor, "v h w 3"], names: Sequence[str]
) -> Float[Tensor, "v h w 3"]:
    """The edited views, clamped to [0, 1]; `names` are those of the views.

    Raises GseditError, with the view, for pictures of another number or size
    than the originals, and for one that holds NaN or infinity.
    """
    if images.shape != originals.shape:
        made, given = (" x ".join(map(str, each.shape)) for each in (images, originals))
        raise GseditError(
            f"the 2D editor made pictures of another size: {made} of {given} (views, height, "
            "width, colors); mend the editor, or choose another with --editor"
        )
    for name, image in zip(names, images):
        bad = ~image.isfinite()
        if bad.any():
            y, x, _ = bad.nonzero()[0].tolist()
            raise GseditError(
                f"the 2D editor made a picture of view {name} with {int(bad.sum())} values that "
                f"are not finite numbers, the first at pixel ({x}, {y}): try "
                "--set precision=float32, another --seed or another --editor"
            )
    return images.clamp(0, 1)
