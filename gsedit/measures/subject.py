"""What is measured: a scene, the views to measure at, and what it is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from jaxtyping import Bool
from torch import Tensor

from gsedit.measures.agreement import Pictures, WarpComparison
from gsedit.measures.clip import Clip
from gsedit.measures.conse import Conse
from gsedit.regions.region import Region
from gsedit.views.view_list import Role, ViewList
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

NO_TARGETS = "there are no edited pictures: add --against with a folder of them, or of an edit"


@dataclass(frozen=True)
class Texts:
    """What the measures with words compare pictures to; None where it was not given."""

    instruction: str | None = None
    """What should change: "turn it into bronze"."""
    source: str | None = None
    """What the unedited scene shows: "a photo of a bear"."""
    target: str | None = None
    """What the edited scene should show: "a photo of a bronze bear"."""

    @property
    def wanted(self) -> str | None:
        """What an edited picture should look like: the target's caption, or the instruction."""
        return self.target or self.instruction


@dataclass(frozen=True, eq=False)
class Subject:
    """What is measured, and beside what."""

    scene: Gaussians
    views: ViewList
    targets: Pictures = field(default_factory=dict)
    """Pictures that the scene should show, by the index of the view: edited ones, or photos."""
    no_targets: str = NO_TARGETS
    """Why there are none, where there are none, and what to do."""
    unedited: Gaussians | None = None
    region: Region | None = None
    """Where the edit belonged, of the unedited scene's Gaussians."""
    texts: Texts = field(default_factory=Texts)
    clip: Clip | None = None
    conse: Conse | None = None
    execution: Execution = AUTO
    masks: Mapping[int, Bool[Tensor, "h w"]] = field(default_factory=dict)
    """Of targets: where they are False, nothing is compared. By the index of the view."""


@dataclass(frozen=True)
class Mean:
    """Of a metric over views."""

    value: float
    views: int
    """Over how many."""


Means = Mapping[str, Mapping[Role, Mean]]
"""By the name of the metric (gsedit.measures.names) and the role of the views."""


@dataclass(frozen=True)
class ViewMeasures:
    """Of one view."""

    name: str
    role: Role
    values: Mapping[str, float]
    """By the name of the metric, those that a single view has."""


@dataclass(frozen=True)
class Evaluation:
    """What was measured."""

    measured: Means
    warp: tuple[WarpComparison, ...]
    not_measured: Mapping[str, str]
    """Why, and what to do, by the name of the metric; "psnr_to_targets at held_out views" where
    only those of one role have no value."""
    views: tuple[ViewMeasures, ...]
    """Those that were measured at, in the order of the list."""

    def number(self, role: Role) -> int:
        """Views of that role that were measured at."""
        return sum(view.role == role for view in self.views)
