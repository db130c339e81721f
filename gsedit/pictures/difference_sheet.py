"""Scenes beside what they are compared with, and where they differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
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


def difference_picture(
    before: Sequence[View],
    after: Sequence[View],
    names: tuple[str, str],
    path: Path,
    *,
    overwrite: bool = False,
) -> None:
    """Write a PNG of two scenes from the same cameras, under their names, and of their difference.

    The difference of a pixel is that of its most different channel; white is the 99.9th percentile
    over all views, at least 4/255. Raises UsageError as `atomic_path` does.
    """
    apart = [(b.image - a.image).abs().amax(-1, keepdim=True) for a, b in zip(before, after)]
    ordered = torch.cat([each.flatten() for each in apart]).sort().values
    most = max(float(ordered[int(0.999 * (len(ordered) - 1))]), 4 / 255)
    differences = [
        View(view.name, view.camera, (each / most).clamp(0, 1).expand(-1, -1, 3))
        for view, each in zip(before, apart)
    ]
    title = f"largest difference of a channel, {1 / most:.3g} times"
    rows = [(names[0], before), (names[1], after), (title, differences)]
    save_picture(contact_sheet(rows), path, overwrite=overwrite)
