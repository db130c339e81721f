"""Why a metric could not be measured, and what to do: nothing is missing without a word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gsedit.datasets.view_list_files import Role
from gsedit.measures import perceptual
from gsedit.measures.agreement import PicturesOf, WarpComparison
from gsedit.measures.evaluation_input import EvaluationInput, Means
from gsedit.measures.names import METRICS, POINTS, WARP
from gsedit.measures.points import PointComparison

MEASURED_ROLES: tuple[Role, ...] = ("edited", "held_out")
NO_UNEDITED = "the unedited scene is not known: add --against SCENE, or the folder of an edit"
NO_EDITS_ALONE = (
    "no held-out view was edited alone: only an edit by a 2D editor that is a diffusion model has "
    "such pictures, in held_out_alone/ of its folder"
)
NO_MASKS = "no masks were given: add --subject-masks FOLDER, a mask for each of some views"
NO_MATCHER = "points are matched by gsedit metrics, not during an edit: run it on the folder"
HELD_OUT_ONLY = ("psnr_to_edits_alone", "ssim_to_edits_alone", "perceptual_to_edits_alone")


def find_missing(
    subject: EvaluationInput,
    measured: Means,
    warp: Sequence[WarpComparison],
    points: Mapping[PicturesOf, PointComparison | str],
) -> dict[str, str]:
    """By the name of the metric, or of the metric and the role of views that have no value."""
    found: dict[str, str] = {}
    for name in METRICS:
        by_role = measured.get(name, {})
        if not by_role:
            found[name] = _reason(name, subject)
            continue
        for role in MEASURED_ROLES:
            if role not in by_role and "all" not in by_role and name not in HELD_OUT_ONLY:
                found[f"{name} at {role} views"] = _reason_of_role(role, subject)
    rows = {WARP[row.pictures, row.range] for row in warp}
    found |= {name: _warp_reason(name, subject) for name in WARP.values() if name not in rows}
    for kind, name in POINTS.items():
        if not isinstance(row := points.get(kind), PointComparison):
            found[name] = row or _points_reason(kind, subject)
    return found


def _reason(name: str, subject: EvaluationInput) -> str:
    """Why no view has a value."""
    kind, _, to = name.partition("_to_")
    if not any(role in MEASURED_ROLES for role in subject.views.roles):
        return "no view of the list is edited or held out: give some of them such a role"
    if to == "targets" and not subject.targets:
        return subject.no_targets
    if to == "edits_alone" and not subject.edits_alone:
        return NO_EDITS_ALONE
    if name.endswith("_outside_masks") and not subject.subject_masks:
        return NO_MASKS
    if (to == "unedited" or "_outside_" in name) and subject.unedited is None:
        return NO_UNEDITED
    if kind == "perceptual":
        return _no_perceptual()
    if "_outside_" in name:
        return _no_region(subject)
    return "the edited and held-out views have no picture to compare with: name the views that have"


def _no_perceptual() -> str:
    if not perceptual.is_installed():
        return f"its weights are not installed: {perceptual.INSTALL}"
    return f"views have fewer than {perceptual.SMALLEST} pixels a side: measure at a larger --size"


def _no_region(subject: EvaluationInput) -> str:
    if subject.region is None:
        return "no region is known: add --region, such as the region.npy of the edit"
    if subject.region.is_all:
        return "the region is everything, so nothing is outside: name a smaller --region if it is"
    return "no pixel of these views is outside the region: add views that show more"


def _reason_of_role(role: Role, subject: EvaluationInput) -> str:
    """Why the views of that role have no value, where those of another have one."""
    if not subject.views.having(role):
        return f"no view of the list is {role.replace('_', ' ')}: give some that role"
    return "none of them has a picture to compare with: add pictures named after them"


def _warp_reason(name: str, subject: EvaluationInput) -> str:
    if subject.unedited is None:
        return NO_UNEDITED
    targets = sum(i in subject.targets for i in subject.views.having("edited"))
    if name.startswith("warp_targets") and not subject.targets:
        return subject.no_targets
    if name.startswith("warp_targets") and targets < 2:
        return "two edited views with a picture are needed: add pictures of edited views"
    if name == "warp_renders_long" and len(subject.views.having("held_out")) < 2:
        return "two held-out views are needed: add some to the list"
    if name == "warp_renders_short" and not subject.views.having("held_out"):
        return "a held-out view is needed: add one to the list"
    return "no two views share 1 % of their pixels: add views that see each other"


def _points_reason(kind: PicturesOf, subject: EvaluationInput) -> str:
    """Why no points were looked for."""
    if subject.unedited is None:
        return NO_UNEDITED
    if kind == "targets" and not subject.targets:
        return subject.no_targets
    if subject.matcher is None:
        return NO_MATCHER
    which = "edited views with a picture" if kind == "targets" else "held-out views"
    return f"two {which} that look in similar directions are needed: add views to the list"
