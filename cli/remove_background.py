"""`gsedit remove-background`: the subject alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import current_scene

if TYPE_CHECKING:
    from gsedit.points.operation import Operation

ABOUT_THE_SUBJECT = "turn it into bronze"
"""An instruction that is about the subject alone: the editor `small` says where that is."""

Cameras = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DATASET",
        show_default="cameras.json beside the scene, else found views",
        help="The cameras: posed photos, or a cameras.json.",
    ),
]
Within = Annotated[
    float | None,
    typer.Option(
        "--within",
        metavar="FRACTION",
        show_default=False,
        help="Instead of the subject, keep what is nearer to the point that the cameras look at "
        "than this times their median distance from it; 1 is about what an orbit encloses.",
    ),
]
Grow = Annotated[
    float | None,
    typer.Option(
        "--grow", metavar="LENGTH", show_default=False, help="Keep also what is so near to it."
    ),
]


def remove_background(
    data: Cameras = None, within: Within = None, grow: Grow = None
) -> list[Operation]:
    """Keep the subject, and leave out everything else: what the learned editor takes for the
    subject in renders, or with --within what the cameras stand around.

    gsedit remove-background bear.ply --data photos/ -o bear_alone.ply

    gsedit remove-background bear.ply --data photos/ --within 0.6 --dry-run
    """
    from gsedit.points.background import InTheMiddle, RemoveBackground
    from gsedit.points.selection import forms

    from .selection_region import Subject, recorded_cameras

    scene = current_scene.get()
    if within is None:
        selection = Subject(ABOUT_THE_SUBJECT, scene, data)
    else:
        selection = InTheMiddle(recorded_cameras("--within", data), within, scene)
    kept = selection if grow is None else forms.grow(selection, grow)
    return [RemoveBackground(selection=kept)]
