"""The region of an edit: named or predicted before any view is edited, or voted by edited views."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.cameras.around import around
from gsedit.datasets.dataset import Dataset
from gsedit.datasets.viewpoints import viewpoints_of
from gsedit.editing.session.request import Request
from gsedit.editor_protocol import Editor
from gsedit.errors import UsageError
from gsedit.runs.events import Event
from gsedit.runs.stopwatch import Stopwatch
from gsedit.select.finder import Finder
from gsedit.select.lift import find_changed, lift
from gsedit.select.region import Region, everything
from gsedit.words.read import read_instruction
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


def choose_region(request: Request, stopwatch: Stopwatch) -> Generator[Event, None, Region | None]:
    """The region of a request; None where it is known only from the edited views.

    Raises UsageError where it would be empty, InputError for a file that does not fit.
    """
    with stopwatch.stage("region"):
        whole = is_whole(request.editor, request.prompt)
        finder = Finder(
            request.scene,
            viewpoints_of(Dataset(request.every_view)),
            request.settings.region,
            execution=request.settings.execution,
            coarse=request.coarse,
        )
        region = _found(finder, whole)
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

    `auto` is the subject unless the instruction is about the whole scene, as the editor has it
    (None: as it reads). Raises UsageError where an editor's edits have to show what it is about,
    where the region is empty, or for a text that names no region; InputError for a file that does
    not fit.
    """
    dataset = dataset or around(scene, execution=execution)
    whole = is_whole(editor, prompt) if prompt else False
    found = _found(Finder(scene, viewpoints_of(dataset), region, execution=execution), whole)
    if found is None:
        raise UsageError(
            f"what {prompt!r} is about is known only from its edited views: gsedit edit finds it, "
            "and writes region.npy; or name the part with --region"
        )
    return found


def _found(finder: Finder, whole: bool | None) -> Region | None:
    """The region of a finder; `auto` is everything where an instruction is about the `whole`
    scene, and None where that is not known."""
    if finder.region != "auto" or whole is False:
        return finder.subject
    if whole is None:
        return None
    note = "auto: the instruction is about the whole scene"
    return Region(everything(finder.scene).inside, note)


def is_whole(editor: Editor | None, prompt: str) -> bool | None:
    """Whether an instruction is about the whole scene, and not its subject alone; None where
    the sentence does not say. Editors with a known ground truth edit whole pictures."""
    if editor is not None and editor.capabilities.find_ground_truth is not None:
        return True
    targets = {change.target for change in read_instruction(prompt).changes}
    if "background" in targets or not targets:
        return None
    return "scene" in targets


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
