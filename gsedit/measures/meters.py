"""The meter of each metric: the pictures, region or masks that its numbers were measured by."""

from __future__ import annotations

from gsedit.datasets.view_list_files import Role
from gsedit.measures.evaluation_input import EvaluationInput

BY_TO = {
    "edits_alone": "edits made alone, without the targets",
    "unedited": "renders of the unedited scene",
    "ground_truth": "the true edit, which is known",
}


def measured_against(name: str, role: Role, subject: EvaluationInput) -> str:
    """The meter of a metric of views of that role, as its record tells it."""
    _, _, to = name.partition("_to_")
    if to == "targets":
        return subject.targets_are[role != "edited"]
    if "_outside_" in name:
        return subject.region_is
    return BY_TO[to]
