"""The result of an edit: the scene, where its Gaussians come from, and its evidence, measured at
some of the views that an edit holds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsedit.editing.parts import Parts
from gsedit.editing.plan import PICTURE, key_of
from gsedit.measures.evaluation import evaluate
from gsedit.measures.metrics import METRICS, Evaluation, EvaluationInput, Means
from gsedit.paper.evaluate import Drawing, EditMetrics, Evidence, HeldOutViews
from gsedit.paper.settings import EditSettings
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.pictures.notebook import as_html, attempt, decibels, png_bytes
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.outcome import NEW, Outcome
from gsedit.select.finder import Finder
from gsedit.select.region import Region
from gsedit.views.dataset import View, capture, evenly_spaced
from gsedit.views.view_list_files import HELD_OUT_EVERY, ViewList
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.instruction import Instruction
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False, kw_only=True)
class EditResult(Evidence):
    """An edited scene and its evidence: the same cameras three times."""

    prompt: str
    scene: Gaussians
    region: Region
    """The Gaussians that could change, of `scene`."""
    region_before: Region | None = None
    """The Gaussians of the unedited scene that changed or are gone; None where its rows stay."""
    origin: Int[Tensor, " m"] | None = None
    """The row in the unedited scene of each Gaussian, NEW (gsedit.scene.outcome) for a new one;
    None where its rows stay."""
    understood: Instruction | None = None
    """The changes that were read in the sentence; None where a 2D editor got it as it is."""
    notes: tuple[str, ...] = ()
    """Remarks for a person on how changes were done on the Gaussians."""

    def __repr__(self) -> str:
        return f"EditResult({self.prompt!r}, {self.scene!r})"

    def _repr_png_(self) -> bytes | None:
        """A picture for notebooks: some views before the edit, as edited in 2D, and after it."""
        return attempt(self._picture)

    def _repr_html_(self) -> str | None:
        """A page for notebooks: the pictures and the measurements."""
        return attempt(lambda: as_html(self.prompt, self._rows(), self._picture()))

    def _picture(self) -> bytes:
        originals, finals = self.originals, self.finals
        if not originals:
            originals, finals = self.held_out.originals, self.held_out.finals
        rows = {"original": originals, "2D targets": self.targets, "edited": finals}
        shown = [(label, views) for label, views in rows.items() if views]
        return png_bytes(contact_sheet(shown, columns=4))

    def _rows(self) -> dict[str, str]:
        metrics = self.metrics
        return {
            "Gaussians": f"{len(self.scene):,}",
            "region": str(self.region),
            "strategy": self.strategy_name,
            "seconds": f"{self.timings['total']:.0f}" if "total" in self.timings else "",
            "PSNR to the 2D targets": decibels(metrics.psnr_to_targets),
            "PSNR to edits of held-out views": decibels(metrics.psnr_to_held_out_edits),
            "PSNR to held-out edits made alone": decibels(metrics.psnr_to_edits_alone),
            "PSNR outside the region": decibels(metrics.psnr_outside_region),
        }


LEAST_RMSE = 0.005
"""RMSE to the unedited views below which the user is told that hardly anything changed: painting a
subject of one pixel in a hundred makes six times as much."""
HARDLY = "hardly anything changed: the scene has little that this acts on"


@dataclass(frozen=True, eq=False)
class Changed:
    """A scene that an edit changed."""

    scene: Gaussians
    region: Region
    """Gaussians that any of the changes could reach, new ones among them."""
    notes: tuple[str, ...] = ()
    """Remarks for a person on how it was done."""
    region_before: Region | None = None
    """Gaussians of the scene before that are changed or gone; None where rows stay the same."""
    origin: Int[Tensor, " m"] | None = None
    """Row in the scene before of each Gaussian, NEW for a new one; None where rows stay."""
    drawing: Drawing | None = None
    """The last drawing of a 2D editor, if one drew."""


def changed_by(
    scene: Gaussians,
    steps: Sequence[Instruction],
    parts: Parts,
    total: Outcome,
    drawing: Drawing | None = None,
    notes: Sequence[str] = (),
) -> Changed:
    """All that the steps changed: the last scene, and the regions before and after."""
    changes = [each for step in steps for each in step.changes]
    told = tuple(dict.fromkeys((*notes, *total.notes)))
    keys = dict.fromkeys(key_of(change) for change in changes if change.name != "insert")
    known = [parts.found[key] for key in keys if key in parts.found]
    found, hows = (dict.fromkeys(map(attrgetter(name), known)) for name in ("note", "how"))
    sure = min((each.sure for each in known), default=1.0)
    region = Region(total.changed, "; ".join(found) or "what is new", " or ".join(hows), sure)
    if drawing is not None and len(steps) == 1:
        region = drawing.region
    if torch.equal(total.origin, torch.arange(len(scene))):
        return Changed(total.scene, region, told, drawing=drawing)
    before = Region(_touched(total, len(scene)), region.note)
    return Changed(total.scene, region, told, before, total.origin, drawing)


def _touched(outcome: Outcome, count: int) -> Bool[Tensor, " n"]:
    """Whether each of the `count` Gaussians before is changed or in the scene no longer."""
    touched = outcome.dropped(count)
    touched[outcome.origin[outcome.changed & (outcome.origin != NEW)]] = True
    return touched


def measured(
    finder: Finder,
    changed: Changed,
    sentence: str,
    steps: Sequence[Instruction],
    settings: EditSettings,
    watch: Stopwatch,
) -> EditResult:
    """The result of an edit of the finder's scene.

    A drawing brings its own measurements; where other changes are beside it, those of the whole are
    measured anew.
    """
    drawing, scene, notes = changed.drawing, finder.scene, changed.notes
    evidence = _evidence(settings) if drawing is None else drawing.evidence
    if drawing is None or len(steps) > 1:
        with watch.stage("measure"):
            shown = held_out(finder.viewpoints)
            before = pictures_at(scene, shown)
            after = pictures_at(changed.scene, shown)
            means = means_of(scene, changed, before, after)
        metrics = evidence.metrics.with_means(means)
        evidence = replace(evidence, metrics=metrics)
        if drawing is None:
            evidence = replace(evidence, held_out=HeldOutViews(before, (), after))
        else:
            evidence = of_the_whole(evidence, scene, changed.scene)
        if (metrics.rmse_to_unedited or 0.0) <= LEAST_RMSE:
            notes = (*notes, HARDLY)
    drawing_s, total = evidence.timings, sum(watch.stages.values())
    own = {**watch.stages, "total": total}
    spent = {k: own.get(k, 0.0) + drawing_s.get(k, 0.0) for k in (own | drawing_s)}
    shared: dict[str, Any] = {**vars(evidence), "timings": spent}
    return EditResult(
        **shared,
        prompt=sentence,
        scene=changed.scene,
        region=changed.region,
        region_before=changed.region_before,
        origin=changed.origin,
        understood=understood(steps),
        notes=notes,
    )


def understood(steps: Sequence[Instruction]) -> Instruction | None:
    """The changes of all steps; None where a 2D editor got the sentence as it is."""
    changes = tuple(each for step in steps for each in step.changes)
    if changes[0].route == PICTURE:
        return None
    words = "; ".join(step.text for step in steps)
    return steps[0] if len(steps) == 1 else Instruction(words, True, words, changes)


def of_the_whole(evidence: Evidence, before: Gaussians, after: Gaussians | None) -> Evidence:
    """The evidence of a drawing, its renders those of the scene before and after all changes; None:
    those after are right as they are."""
    held_out, drawn = evidence.held_out, (evidence.finals, evidence.held_out.finals)
    finals, held = drawn if after is None else (pictures_at(after, each) for each in drawn)
    return replace(
        evidence,
        originals=pictures_at(before, evidence.originals),
        finals=finals,
        held_out=replace(held_out, originals=pictures_at(before, held_out.originals), finals=held),
    )


def _evidence(settings: EditSettings) -> Evidence:
    """The evidence of an edit that nothing has been measured of."""
    metrics = EditMetrics(Evaluation({}, (), {}, ()))
    return Evidence(metrics=metrics, timings={}, settings=settings, held_out=HeldOutViews())


def held_out(viewpoints: Sequence[Viewpoint]) -> tuple[Viewpoint, ...]:
    """Some of the views that an edit holds out."""
    every = viewpoints[::HELD_OUT_EVERY]
    return tuple(every[i] for i in evenly_spaced(len(every), 4))


def pictures_at(scene: Gaussians, viewpoints: Sequence[Viewpoint | View]) -> tuple[View, ...]:
    """Renders of a scene as views at these, whatever they show."""
    cameras, names = [each.camera for each in viewpoints], [each.name for each in viewpoints]
    return tuple(capture(scene, cameras, names))


def means_of(
    scene: Gaussians,
    changed: Changed,
    before: Sequence[View],
    after: Sequence[View],
    edited: int = 0,
) -> Means:
    """The difference of views, of which the first were `edited` and the others held out, and how
    well what is outside the region is kept."""
    moved = changed.region_before is not None
    viewpoints = tuple(Viewpoint(each.name, each.camera) for each in before)
    given = EvaluationInput(
        changed.scene,
        ViewList(viewpoints, ("edited",) * edited + ("held_out",) * (len(before) - edited)),
        unedited=scene,
        region=changed.region_before if moved else changed.region,
        edited_region=changed.region if moved else None,
        finals={i: each.image for i, each in enumerate(after)},
        originals={i: each.image for i, each in enumerate(before)},
    )
    return evaluate(
        given, only=[name for name, row in METRICS.items() if row.of_gaussians]
    ).measured
