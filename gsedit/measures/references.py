"""References of metrics: the pictures, region or masks that each metric is compared with."""

from __future__ import annotations

from gsedit.datasets.view_list_files import Role
from gsedit.measures.evaluation_input import EvaluationInput

BY_TO = {
    "edits_alone": "edits made alone, without the targets",
    "unedited": "renders of the unedited scene",
    "ground_truth": "the true edit, which is known",
}


def measured_against(name: str, role: Role, subject: EvaluationInput) -> str:
    """The reference of a metric at views of that role, as its record names it."""
    _, _, to = name.partition("_to_")
    if to == "targets":
        return subject.targets_are[role != "edited"]
    if "_outside_" in name:
        return subject.region_is
    return BY_TO[to]
