"""A scene beside what it is compared with, and where they differ."""

from __future__ import annotations

from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from gsedit.formats.pictures import save_picture
from gsedit.measures.agreement import spread
from gsedit.measures.evaluation_input import EvaluationInput
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.scene.picture import render_picture
from gsedit.views.dataset import View

EDITED, HELD_OUT = 4, 2
"""Most views that are shown of each kind."""
AMPLIFIED = 4
"""How much larger differences are drawn than they are."""


def difference_sheet(
    subject: EvaluationInput, path: Path, targets: str, *, overwrite: bool = False
) -> None:
    """Write a PNG: the unedited scene, the pictures that it should show (`targets` says what they
    are), the scene, and the absolute difference to the first of the two rows that there is, four
    times. Raises UsageError as `atomic_path` does."""
    held_out = spread(subject.views.having("held_out"), HELD_OUT)
    shown = (*spread(subject.views.having("edited"), EDITED), *held_out)

    def views(pictures: dict[int, Float[Tensor, "h w 3"]]) -> list[View | None]:
        viewpoints = subject.views.viewpoints
        return [
            View(viewpoints[i].name, viewpoints[i].camera, pictures[i]) if i in pictures else None
            for i in shown
        ]

    cameras = {i: subject.views.viewpoints[i].camera for i in shown}
    execution = subject.execution
    finals = {i: render_picture(subject.scene, each, execution) for i, each in cameras.items()}
    rows, before = [], {}
    if subject.unedited is not None:
        original = subject.unedited
        before = {i: render_picture(original, each, execution) for i, each in cameras.items()}
        rows.append(("unedited scene", views(before)))
    wanted = {i: subject.targets[i] for i in shown if i in subject.targets}
    if wanted:
        rows.append((targets, views(wanted)))
    expected, named = (before, "unedited scene") if before else (wanted, targets)
    differences = {
        i: (AMPLIFIED * (finals[i] - picture).abs()).clamp(0, 1) for i, picture in expected.items()
    }
    rows += [
        ("this scene", views(finals)),
        (f"difference to the {named}, {AMPLIFIED} times", views(differences)),
    ]
    sheet = contact_sheet(rows, apart=len(held_out), caption="held out" if held_out else "")
    save_picture(sheet, path, overwrite=overwrite)
