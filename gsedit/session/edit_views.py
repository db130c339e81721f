"""Ask the 2D editor for a batch of views that agree with each other and with the finished ones."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator, Mapping, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.consistency.correspond import Correspondences, correspond
from gsedit.consistency.depth_maps import DEFAULT_RULES, NO_RULES
from gsedit.consistency.harmonise_by_depth import Surface, harmonise_by_depth
from gsedit.diffusion import SamplerSettings
from gsedit.editors.protocol import EditBatch
from gsedit.regions.region import coverage
from gsedit.reports.events import Event
from gsedit.savings.pictures import APART
from gsedit.session.answers import checked
from gsedit.session.choose_region import vote_region
from gsedit.session.quality import mean
from gsedit.session.session import Session
from gsedit.views.dataset import View
from gsedit.views.guided import carry_change
from gsedit.views.image_ops import downscale
from gsedit.views.padding import pad_camera, pad_to_multiple
from gsedit.views.plan import view_overlap
from rasterizer.camera import Camera

WEAK_MATCH = 0.05
"""Below this fraction of matched cells a pair of views has little to agree on: worth a warning."""
MEASURE = "measure"
"""The stage in which the editor is asked for views to compare the result with."""
ANCHORS = 4
"""Most finished views that the next batch is tied to. They cost comparisons, no network call."""
ANCHOR_OVERLAP = 0.3
"""Least overlap of a further anchor with the new views: below it few cells match (0.12 of them on
the bear), and a view's cells are compared for nothing."""


def edit_views(
    session: Session,
    batch: Sequence[int],
    *,
    step: int = 0,
    steps: int = 0,
    sampler: SamplerSettings | None = None,
    anchors: int = ANCHORS,
) -> Iterator[Event]:
    """Edit the views with these indices together, tied to finished ones by anchors.

    This is batch `step` of `steps`. `sampler` overrules the settings'; `anchors` is the
    most of them, 0 for none. The targets, pairs and ground truth of `session.edited` are brought up
    to date.
    """
    sampler = sampler or session.settings.sampler
    edited, stopwatch = session.edited, session.stopwatch
    tied = _anchors(session.surveyed.weights, batch, edited.targets)[:anchors]
    members = (*batch, *tied)
    with stopwatch.stage("correspond"):
        matches = match_views(session, members)
    edited.pairs += _named_pairs(matches, [session.views[i].name for i in members])
    yield Event("correspond", stopwatch.seconds, step, steps, note=_describe(matches))
    with stopwatch.stage("sample"):
        images = yield from sample_views(session, members, tied, matches, sampler)
    yield from _accept(session, dict(zip(batch, images)), step, steps)


def edit_alone(
    session: Session, view: int, sampler: SamplerSettings, *, step: int = 0, steps: int = 0
) -> Iterator[Event]:
    """Edit the view with this index on its own: with noise of its own, tied to no other view.

    This is edit `step` of `steps`. The targets and the ground truth of `session.edited` are brought
    up to date.
    """
    with session.stopwatch.stage("sample"):
        images = yield from sample_views(session, (view,), (), None, sampler)
    yield from _accept(session, {view: images[0]}, step, steps)


def _accept(
    session: Session, answers: Mapping[int, Float[Tensor, "h w 3"]], step: int, steps: int
) -> Iterator[Event]:
    """Make what the editor answered the targets of these views, within the region."""
    edited = session.edited
    edited.answers |= answers
    with session.stopwatch.stage("region"):
        yield from vote_region(session, step, steps)
        for i in edited.answers if edited.voted else answers:  # a vote changes the earlier ones too
            image = session.within_region(i, edited.answers[i])
            view = session.views[i]
            edited.targets[i] = View(view.name, view.camera, image)
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
    """The 2D editor's pictures of `members` but `anchors`, which stay as they were edited.

    Without `matches` every view is edited on its own.
    Sampling begins at `start`, or where the scene is now. Everything that a target goes through
    belongs here: held-out views are asked for in the same way. Views larger than the editor's size
    are edited small, and their change is carried up. Yields events of the `stage`.
    """
    request = request_of(session, members, anchors, matches, start)
    editor, images = session.request.editor, None
    evaluations = 0
    for progress in editor.edit(request, sampler, session.request.generator):
        yield Event(stage, session.stopwatch.seconds, progress.step, progress.steps)
        images, evaluations = progress.images, progress.evaluations
    if stage != MEASURE:  # what the result is compared with is no cost of the edit
        session.work.calls += len(members) - len(anchors)
        session.work.evaluations += evaluations
    if images is None:
        raise RuntimeError(f"editor {editor.name} ended without images")
    images = checked(images, request.originals, [session.views[i].name for i in members])
    if matches and sampler.consensus and sampler.harmonise:
        images = _harmonised(session, members, images, request.anchored, sampler)
    small = dict(zip(members, zip(images, request.originals)))
    return [_at_full_size(session, i, *small[i]) for i in members if i not in anchors]


def _at_full_size(
    session: Session, i: int, edited: Float[Tensor, "y x 3"], original: Float[Tensor, "y x 3"]
) -> Float[Tensor, "h w 3"]:
    """View i as it was edited, or, where it was edited small, with its change at full size."""
    full = session.unedited_image(i)
    return carry_change(edited[None].to(full), original[None].to(full), full[None])[0]


def find_ground_truth(session: Session, edited: Mapping[int, Float[Tensor, "h w 3"]]) -> None:
    """Find the true edit that these pictures of views show, where the editor has one."""
    find = session.request.editor.capabilities.find_ground_truth
    if find is not None:
        images = torch.stack(list(edited.values()))
        originals = torch.stack([session.unedited_image(i) for i in edited])
        session.edited.ground_truth = find(session.request.prompt, images, originals)


def match_views(session: Session, members: Sequence[int]) -> Correspondences:
    """Latent cells of these views that show the same place, by the unedited scene's depth."""
    cell = session.request.editor.cell
    renderings = [session.edit_rendering(i) for i in members]
    depths = [r.median_depth for r in renderings if r.median_depth is not None]
    alphas = [r.alpha for r in renderings]
    # up to whole cells nothing is seen: alpha 0
    return correspond(
        [pad_camera(session.edit_camera(i), cell) for i in members],
        pad_to_multiple(torch.stack(depths), cell, "constant"),
        pad_to_multiple(torch.stack(alphas), cell, "constant"),
        cell=cell,
        rules=DEFAULT_RULES if session.settings.visibility else NO_RULES,
        apart=_apart(session, members),
    )


def _apart(session: Session, members: Sequence[int]) -> set[tuple[int, int]]:
    """Pairs of positions in `members` whose views were surveyed to share next to nothing."""
    surveyed = session.surveyed.weights
    known = [k for k, i in enumerate(members) if i < len(surveyed)]
    settings = session.settings
    is_decided = settings.leaves_out("correspondences") and settings.visibility
    if not is_decided or len(known) < 2:
        return set()
    rows = surveyed[[members[k] for k in known]]
    shared = view_overlap(rows, rows)
    pairs = itertools.combinations(range(len(known)), 2)
    return {(known[a], known[b]) for a, b in pairs if shared[a, b] < APART}


def _harmonised(
    session: Session,
    members: Sequence[int],
    images: Float[Tensor, "v h w 3"],
    anchored: Bool[Tensor, " v"] | None,
    sampler: SamplerSettings,
) -> Float[Tensor, "v h w 3"]:
    """The editor's pictures of these views, their coarse colours brought to agreement."""
    surfaces = []
    for i in members:
        rendering = session.edit_rendering(i)
        assert rendering.median_depth is not None
        camera, color = session.edit_camera(i), rendering.color.clamp(0, 1)
        surfaces.append(Surface(camera, rendering.median_depth, rendering.alpha, color))
    strength = sampler.consensus_strength
    return harmonise_by_depth(images, surfaces, anchored=anchored, strength=strength)


def request_of(
    session: Session,
    members: Sequence[int],
    anchors: Sequence[int] = (),
    matches: Correspondences | None = None,
    start: Mapping[int, Float[Tensor, "h w 3"]] | None = None,
) -> EditBatch:
    """The new views at `start` (None: current renders), and the anchors as they were edited; all at
    the size at which they are edited."""
    answers = session.edited.answers
    cameras = {i: session.edit_camera(i) for i in members}
    new = [i for i in members if i not in anchors]
    start = start or {i: session.preview(i, cameras[i]) for i in new}
    images = [_fitted(answers[i] if i in anchors else start[i], cameras[i]) for i in members]
    originals = [_fitted(session.unedited_image(i), cameras[i]) for i in members]
    return EditBatch(
        images=torch.stack(images),
        originals=torch.stack(originals),
        prompt=session.request.prompt,
        correspondences=matches,
        anchored=torch.tensor([i in anchors for i in members]),
        subject=_subject(session, [cameras[i] for i in members]),
        seed=session.noise_seed,
    )


def _subject(session: Session, cameras: Sequence[Camera]) -> Float[Tensor, "v h w"] | None:
    """The region in pictures of the unedited scene, for editors that can be told; None where the
    editor decides: the region is everything, or comes from its edits.
    """
    if session.region.is_all or session.edited.voted:
        return None
    scene, execution = session.request.scene, session.settings.execution
    return torch.stack([coverage(session.region, scene, c, execution) for c in cameras])


def _fitted(image: Float[Tensor, "h w 3"], camera: Camera) -> Float[Tensor, "y x 3"]:
    """The picture, as small as the camera's; weights may leave [0, 1] by rounding."""
    return downscale(image, camera.width, camera.height).clamp(0, 1)


def _anchors(
    weights: Float[Tensor, "v n"], batch: Sequence[int], targets: Mapping[int, View]
) -> tuple[int, ...]:
    """The finished views that the new ones overlap with, the most first: they tie the rounds.

    Always the best-tied one; others where their overlap is at least `ANCHOR_OVERLAP` on average.
    """
    finished = [i for i in targets if i not in batch]
    if not finished:
        return ()
    common = view_overlap(weights[finished], weights[list(batch)]).mean(1)
    order = common.argsort(descending=True, stable=True).tolist()
    return tuple(finished[i] for i in order if i == order[0] or common[i] >= ANCHOR_OVERLAP)


def _named_pairs(matches: Correspondences, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Every two views of a batch with the fraction of their cells that match."""
    pairs = itertools.combinations(range(len(names)), 2)
    return [(names[a], names[b], float(matches.matched[a, b])) for a, b in pairs]


def _describe(matches: Correspondences) -> str:
    """How much the views of a batch have in common, for a person."""
    pairs = itertools.combinations(range(len(matches.matched)), 2)
    shares = [float(matches.matched[a, b]) for a, b in pairs]
    if not shares:
        return "one view: there is no other to agree with"
    warning = "; the views see little of each other" if mean(shares) < WEAK_MATCH else ""
    return (
        f"{mean(shares):.0%} of cells matched per pair ({min(shares):.0%} to {max(shares):.0%}), "
        f"{matches.covered.mean():.0%} in a cluster{warning}"
    )
