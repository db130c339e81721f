"""Records of an evaluation: what is measured and compared, and the values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.measures.agreement import Matcher, Pictures, PointComparison, WarpComparison
from gsedit.measures.interval import Interval
from gsedit.select.region import Region
from gsedit.views.view_list_files import Role, ViewList
from rasterizer.render import Rendering
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
    warp: tuple[WarpComparison, ...]
    not_measured: Mapping[str, str]
    """The reason, and what to do, by the name of the metric; as in
    "psnr_to_targets at held_out views" where only the views of one role have no value."""
    views: tuple[ViewMeasures, ...]
    """Those that were measured at, in the order of the list."""
    points: tuple[PointComparison, ...] = ()
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
