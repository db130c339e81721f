"""The region of an edit: named or predicted before any view is edited, or voted by edited views."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.around import around
from gsedit.datasets.dataset import Dataset
from gsedit.editing.session.request import Request, split_views
from gsedit.editor_protocol import Editor
from gsedit.editors import make_editor
from gsedit.errors import UsageError
from gsedit.regions.find import PredictSubject, named_region
from gsedit.regions.lift import lift
from gsedit.regions.region import Region, everything
from gsedit.regions.subject import find_changed
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


def choose_region(request: Request, stopwatch: Stopwatch) -> Generator[Event, None, Region | None]:
    """The region of a request; None where it is known only from the edited views.

    Raises UsageError where it would be empty, InputError for a file that does not fit.
    """
    with stopwatch.stage("region"):
        region = named_region(
            request.settings.region,
            request.scene,
            request.views,
            request.held_out,
            request.settings.execution,
            coarse=request.coarse,
            predict=_predictor(request.editor, request.prompt),
        )
    if region is not None and region.note != "all":
        yield Event("region", stopwatch.seconds, 1, 1, note=str(region))
    return region


def find_region(
    scene: Gaussians,
    region: str,
    *,
    dataset: Dataset | None = None,
    editor: Editor | None = None,
    prompt: str = "",
    execution: Execution = AUTO,
) -> Region:
    """The region that an edit with that `--region` may change, found before any edit.

    `auto` needs the instruction, and the editor (None: `small`). Raises UsageError where that
    editor predicts no subject, where the region is empty, or for a text that names no region;
    InputError for a file that does not fit.
    """
    views, held_out = split_views(dataset or around(scene, execution=execution))
    editor = editor or make_editor()
    predict = _predictor(editor, prompt)
    found = named_region(region, scene.detach(), views, held_out, execution, predict=predict)
    if found is None:
        raise UsageError(
            f"the {editor.name} editor does not say where its subject is before it edits: "
            "gsedit edit finds it from the edited views, and writes region.npy"
        )
    return found


def _predictor(editor: Editor, prompt: str) -> PredictSubject | None:
    """The editor's prediction of the instruction's subject; None where it predicts none."""
    predict = editor.capabilities.predict_subject
    return None if predict is None else partial(predict, prompt)


def vote_region(
    scene: Gaussians,
    cameras: Sequence[Camera],
    edited: Mapping[int, Float[Tensor, "h w 3"]],
    originals: Mapping[int, Float[Tensor, "h w 3"]],
    execution: Execution,
) -> Region:
    """The region that the editor changed, voted over the edited views.

    `cameras` are those of all views; `edited` and `originals` are pictures by index.
    """
    changes = [_change(image, originals[i]) for i, image in edited.items()]
    lifted = lift(scene, [cameras[i] for i in edited], changes, execution)
    inside = find_changed(scene, lifted)
    if inside is None:
        return Region(everything(scene).inside, "auto: the edit is of the whole scene")
    return Region(inside, "auto: what the edit changes")


def _change(
    edited: Float[Tensor, "h w 3"], original: Float[Tensor, "h w 3"]
) -> Float[Tensor, "h w"]:
    """The root mean square over the channels of the difference."""
    return torch.sqrt((edited - original).square().mean(-1))
