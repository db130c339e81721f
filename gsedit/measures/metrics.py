"""The metrics of a scene, a row each; what is measured, and the records of the values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.measures import perceptual as learned
from gsedit.measures.agreement import Matcher, PairComparison, Pictures
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.formulas import INSIDE, NEAREST, Interval, nearness, perceptual, rmse, ssim
from gsedit.select.region import Region, coverage
from gsedit.views.view_list_files import Role, ViewList
from rasterizer.render import Rendering, render_picture
from rasterizer.scene import Gaussians

NO_TARGETS = "there are no edited pictures: add --against with a folder of them, or of an edit"

GIVEN = ("pictures that were given", "pictures that were given")
REGION_IS = "the edit's own region"
MEASURED_ROLES: tuple[Literal["edited", "held_out"], ...] = ("edited", "held_out")
Group = Role | Literal["all"]
"""Views whose values have one mean: those of a role, or all that have a given mask."""


@dataclass(frozen=True, eq=False)
class EvaluationInput:
    """A scene that is measured, the views to measure at, and what it is compared with."""

    scene: Gaussians
    views: ViewList
    targets: Pictures = field(default_factory=dict)
    """Pictures that the scene should show, by the index of the view: edited ones, or photos."""
    no_targets: str = NO_TARGETS
    """The reason why there are no targets, where there are none, and what to do."""
    targets_are: tuple[str, str] = GIVEN
    """The source of the targets, at edited and at held-out views, as the record tells it."""
    edits_alone: Pictures = field(default_factory=dict)
    """Edited pictures of held-out views that were made without the targets."""
    unedited: Gaussians | None = None
    region: Region | None = None
    """The region that the edit could change, of the unedited scene's Gaussians."""
    region_is: str = REGION_IS
    """The source of the region, as the record tells it."""
    subject_masks: Mapping[int, Float[Tensor, "h w"]] = field(default_factory=dict)
    """Masks that the edit did not know, by the index of the view: 1 where it belongs, 0 outside."""
    matcher: Matcher | None = None
    """Finds points that unedited renders have in common; None: no difference at points is
    measured."""
    edited_region: Region | None = None
    """The Gaussians of `scene` that the edit made or changed, where objects were removed, moved or
    added; None where its Gaussians are those of the unedited scene, recolored."""
    masks: Mapping[int, Bool[Tensor, "h w"]] = field(default_factory=dict)
    """Masks of targets, by the index of the view: where they are False, nothing is compared."""
    max_perceptual_views: int | None = None
    """Most views of a role at which a perceptual distance is measured, evenly spaced; None for all.
    It takes ten times as long as all other metrics of a picture."""
    quick: bool = False
    """Whether SSIM, perceptual distances and pairs of long range are left to `gsedit metrics`: they
    take as long as painting the views."""
    ground_truth: Pictures = field(default_factory=dict)
    """The true edit, by the index of the view, where it is known."""
    finals: Pictures = field(default_factory=dict)
    """Renders of `scene` in [0, 1] that exist already, by the index of the view."""
    renderings: Mapping[int, Rendering] = field(default_factory=dict)
    """Renders of `unedited` that exist already, with median depth, by the index of the view."""
    originals: Pictures = field(default_factory=dict)
    """Pictures of `unedited` in [0, 1] that exist already, where `renderings` has none."""


@dataclass(frozen=True)
class Mean:
    """The mean of a metric over views."""

    value: float
    views: int
    """The number of views that have a value."""
    interval: Interval | None = None
    """The range in which the value would lie with other views; None of fewer than four."""
    against: str = ""
    """The pictures, region or masks that it was measured by."""


Means = Mapping[str, Mapping[Group, Mean]]
"""By the name of the metric (gsedit.measures.metrics) and the role of the views."""


@dataclass(frozen=True)
class ViewMeasures:
    """The metrics of one view."""

    name: str
    role: Role
    values: Mapping[str, float]
    """Values by the name of the metric: those that a single view has."""


@dataclass(frozen=True)
class Evaluation:
    """The values of all metrics, and the reasons where there is none."""

    measured: Means
    warp: tuple[PairComparison, ...]
    not_measured: Mapping[str, str]
    """The reason, and what to do, by the name of the metric; as in
    "psnr_to_targets at held_out views" where only the views of one role have no value."""
    views: tuple[ViewMeasures, ...]
    """Those that were measured at, in the order of the list."""
    points: tuple[PairComparison, ...] = ()
    """Differences at matched points, of targets and of renders."""

    def number(self, role: Role) -> int:
        """The number of views of that role that were measured at."""
        return sum(view.role == role for view in self.views)

    def value(self, name: str, role: Role = "edited") -> float | None:
        """The mean of a metric over the views of a role; None where it was not measured."""
        mean = self.measured.get(name, {}).get(role)
        return None if mean is None else mean.value

    def record(self) -> dict[str, Any]:
        """All values as JSON has them: means by role, and a row for each kind of warp error and of
        difference at points."""
        rows = {row.name: row.record() for row in (*self.warp, *self.points)}
        return {**self.measured, **rows}


Better = Literal["higher", "lower", "neither"]
Picture: TypeAlias = Float[Tensor, "h w 3"]
Expected: TypeAlias = tuple[Picture, Bool[Tensor, "h w"] | None]
"""A picture, and the pixels at which it is expected; None: all."""


@dataclass(frozen=True, eq=False)
class MeasuredView:
    """The measured scene at one view, and the unedited one; each is rendered once."""

    subject: EvaluationInput
    index: int

    @cached_property
    def final(self) -> Picture:
        """The picture of the measured scene, rendered unless it is there."""
        known, camera = self.subject.finals, self.subject.views.viewpoints[self.index].camera
        if self.index in known:
            return known[self.index]
        return render_picture(self.subject.scene, camera)

    @cached_property
    def unedited(self) -> Picture:
        """The picture of the unedited scene, rendered unless it is there."""
        subject, i = self.subject, self.index
        if i in subject.originals:
            return subject.originals[i]
        if i in subject.renderings:
            return subject.renderings[i].color.clamp(0, 1)
        assert subject.unedited is not None  # `Standard.views` has no view without it
        return render_picture(subject.unedited, subject.views.viewpoints[i].camera)


@dataclass(frozen=True, eq=False)
class Standard:
    """Something that a scene is measured by: pictures of it, or pixels that should stay."""

    views: Callable[[EvaluationInput], Collection[int]]
    """Returns the views, by index, that have it."""
    at: Callable[[MeasuredView], Expected]
    """Returns it at one of these views; a mask without any pixel where that view has none."""
    against: Callable[[EvaluationInput, Group], str]
    """Returns how the record names it, by the role of the views."""
    why_none: Callable[[EvaluationInput], str]
    """Returns why no view has it, and what to do; "" for what is no loss."""
    roles: tuple[Group, ...] = MEASURED_ROLES
    """Roles of the views that should have it; all: views of any role."""
    why_empty: Callable[[EvaluationInput], str] = field(default=lambda subject: NO_PICTURE)
    """Returns why views that have it have no value."""
    pooled: bool = False
    """Whether pixels are pooled over views; a row's function is then of their RMSE."""


NO_PICTURE = (
    "the edited and held-out views have no picture to compare with: name the views that have"
)
NO_UNEDITED = "the unedited scene is not known: add --against SCENE, or the folder of an edit"
NO_EDITS_ALONE = (
    "no held-out view was edited alone: only an edit by a 2D editor has such pictures, in "
    "held_out_alone/ of its folder"
)
NO_MASKS = "no masks were given: add --subject-masks FOLDER, a mask for each of some views"


def _unedited_views(subject: EvaluationInput) -> range:
    return range(0 if subject.unedited is None else len(subject.views))


def _outside_region(view: MeasuredView) -> Expected:
    """The unedited picture, and the pixels of which less than INSIDE comes from the region.

    Where objects went, both places belong to the edit: the one before and the one after.
    """
    subject, camera = view.subject, view.subject.views.viewpoints[view.index].camera
    parts = [(subject.region, subject.unedited)]
    if subject.edited_region is not None:
        parts.append((subject.edited_region, subject.scene))
    shares = [
        coverage(region, scene, camera)
        for region, scene in parts
        if region is not None and scene is not None
    ]
    return view.unedited, torch.stack([share < INSIDE for share in shares]).all(0)


def _no_region(subject: EvaluationInput) -> str:
    if subject.unedited is None:
        return NO_UNEDITED
    if subject.region is None:
        return "no region is known: add --region, such as the region.npy of the edit"
    return "the region is everything, so nothing is outside: name a smaller --region if it is"


TARGETS = Standard(
    lambda subject: subject.targets,
    lambda view: (view.subject.targets[view.index], view.subject.masks.get(view.index)),
    lambda subject, role: subject.targets_are[role != "edited"],
    lambda subject: subject.no_targets,
)
EDITS_ALONE = Standard(
    lambda subject: subject.edits_alone,
    lambda view: (view.subject.edits_alone[view.index], None),
    lambda subject, role: "edits made alone, without the targets",
    lambda subject: NO_EDITS_ALONE,
    ("held_out",),
)
UNEDITED = Standard(
    _unedited_views,
    lambda view: (view.unedited, None),
    lambda subject, role: "renders of the unedited scene",
    lambda subject: NO_UNEDITED,
)
OUTSIDE_REGION = Standard(
    lambda subject: (
        () if subject.region is None or subject.region.is_all else _unedited_views(subject)
    ),
    _outside_region,
    lambda subject, role: subject.region_is,
    _no_region,
    why_empty=lambda _: "no pixel of these views is outside the region: add views that show more",
    pooled=True,
)
OUTSIDE_MASKS = Standard(
    lambda subject: () if subject.unedited is None else subject.subject_masks,
    lambda view: (view.unedited, view.subject.subject_masks[view.index] < INSIDE),
    lambda subject, role: "masks that were given",
    lambda subject: NO_UNEDITED if subject.subject_masks else NO_MASKS,
    ("all",),
    lambda subject: "the given masks leave no pixel outside: give masks of the subject alone",
    pooled=True,
)
GROUND_TRUTH = Standard(
    lambda subject: subject.ground_truth,
    lambda view: (view.subject.ground_truth[view.index], None),
    lambda subject, role: "the true edit, which is known",
    lambda subject: "",
    ("held_out",),
)


def _decibels(error: float) -> float:
    return min(psnr_from_rmse(error), NEAREST)


class Metric(NamedTuple):
    """One metric: its name in records, its label in tables, and how it is measured."""

    name: str
    label: str
    """`{targets}` stands for the kind of targets: pictures, photos."""
    better: Better
    decimals: int
    function: Callable[..., float | None]
    """Takes (picture, expected picture, mask); of a pooled standard the RMSE over its pixels."""
    needs: Standard
    of_gaussians: bool = False
    """Whether changes on the Gaussians have it too: others need a 2D editor's pictures."""


_ROWS = (
    Metric("psnr_to_targets", "PSNR to the {targets}, dB", "higher", 2, nearness, TARGETS),
    Metric("ssim_to_targets", "SSIM to the {targets}", "higher", 4, ssim, TARGETS),
    Metric("perceptual_to_targets", "perceptual distance to the {targets}", "lower", 4,
           perceptual, TARGETS),
    Metric("psnr_to_edits_alone", "PSNR to edits made alone, dB", "higher", 2, nearness,
           EDITS_ALONE),
    Metric("ssim_to_edits_alone", "SSIM to edits made alone", "higher", 4, ssim, EDITS_ALONE),
    Metric("perceptual_to_edits_alone", "perceptual distance to edits made alone", "lower", 4,
           perceptual, EDITS_ALONE),
    Metric("psnr_to_unedited", "PSNR to the unedited scene, dB", "neither", 2, nearness, UNEDITED),
    Metric("ssim_to_unedited", "SSIM to the unedited scene", "neither", 4, ssim, UNEDITED),
    Metric("rmse_to_unedited", "RMSE to the unedited scene", "neither", 4, rmse, UNEDITED,
           of_gaussians=True),
    Metric("rmse_outside_region", "RMSE outside the region", "lower", 4, float, OUTSIDE_REGION,
           of_gaussians=True),
    Metric("psnr_outside_region", "PSNR outside the region, dB", "higher", 2, _decibels,
           OUTSIDE_REGION, of_gaussians=True),
    Metric("rmse_outside_masks", "RMSE outside the given masks", "lower", 4, float, OUTSIDE_MASKS),
    Metric("psnr_outside_masks", "PSNR outside the given masks, dB", "higher", 2, _decibels,
           OUTSIDE_MASKS),
    Metric("psnr_to_ground_truth", "PSNR to the true edit, dB", "higher", 2, nearness,
           GROUND_TRUTH),
    Metric("ssim_to_ground_truth", "SSIM to the true edit", "higher", 4, ssim, GROUND_TRUTH),
    Metric("perceptual_to_ground_truth", "perceptual distance to the true edit", "lower", 4,
           perceptual, GROUND_TRUTH),
)  # fmt: skip
SLOW = (ssim, perceptual)
LATER = "gsedit metrics measures it, not the edit, which would take longer: run it on the folder"
METRICS = {row.name: row for row in _ROWS}
"""Metrics by name, in the order in which they are shown."""
PAIRS = {
    "warp_targets_short": "warp error of {targets}, short range",
    "warp_targets_long": "warp error of {targets}, long range",
    "warp_renders_short": "warp error of renders, short range",
    "warp_renders_long": "warp error of renders, long range",
    "points_targets": "difference at SIFT matches of {targets}",
    "points_renders": "difference at SIFT matches of renders",
}
"""Labels of the errors between views (gsedit.measures.agreement), by name."""
COST = {"seconds": "wall clock of the edit, s", "evaluations": "network evaluations of the edit"}
"""Labels of what an edit took, by name: wall clock, and evaluations of the editor's network."""


def label_of(name: str, targets: str) -> str:
    """Label of a metric of any kind, or of "NAME at ROLE views"."""
    key, _, role = name.partition(" at ")
    label = METRICS[key].label if key in METRICS else {**PAIRS, **COST}[key]
    return label.format(targets=targets) + (f" at {role.replace('_', '-')}" if role else "")


def why_missing(row: Metric, subject: EvaluationInput) -> str:
    """Why no view has a value of a metric; "" for one that is no loss."""
    if not (why_none := row.needs.why_none(subject)):
        return ""
    if not any(role in MEASURED_ROLES for role in subject.views.roles):
        return "no view of the list is edited or held out: give some of them such a role"
    if not row.needs.views(subject):
        return why_none
    if subject.quick and row.function in SLOW:
        return LATER
    if row.function is perceptual:
        if not learned.is_installed():
            return f"its weights are not installed: {learned.INSTALL}"
        return f"views have fewer than {learned.SMALLEST} pixels a side: measure at a larger --size"
    return row.needs.why_empty(subject)


def why_missing_at(role: Role, subject: EvaluationInput) -> str:
    """Why the views of a role have no value, where those of another have one."""
    if not subject.views.having(role):
        return f"no view of the list is {role.replace('_', ' ')}: give some that role"
    return "none of them has a picture to compare with: add pictures named after them"
