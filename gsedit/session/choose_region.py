"""Where an edit belongs, as `--region` says: before any view is edited, or from the edited ones.

`v` views, `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.protocol import Editor
from gsedit.errors import UsageError
from gsedit.regions.lift import lift
from gsedit.regions.masks import read_masks
from gsedit.regions.parse import All, Auto, Box, File, Sphere, parse_region
from gsedit.regions.region import Region, everything, read_flags
from gsedit.regions.subject import find_changed, find_drawn, find_subject
from gsedit.reports.events import Event
from gsedit.reports.stopwatch import Stopwatch
from gsedit.session.session import Request, Session, rendering_of
from gsedit.views.coarse import Coarse
from gsedit.views.dataset import View, evenly_spaced
from rasterizer.camera import Camera
from rasterizer.numerics import Execution
from rasterizer.scene import Gaussians

PREDICTED_SIZE = 128
"""Longer side, pixels, of the pictures in which the subject is predicted. On the bear, `small`
then finds it better than in pictures of 192 (see docs/regions.md), in a quarter of the time."""
PREDICTED_VIEWS = 32
"""Most pictures in which the subject is predicted, evenly spaced."""


def choose_region(request: Request, stopwatch: Stopwatch) -> Generator[Event, None, Region | None]:
    """The region of a request; None where it is known only from the edited views.

    Raises UsageError where it would be empty, InputError for a file that does not fit.
    """
    with stopwatch.stage("region"):
        region = find_region(
            request.settings.region,
            request.scene,
            request.views,
            request.held_out,
            request.editor,
            request.prompt,
            request.settings.execution,
            request.coarse,
        )
    if region is not None and region.note != "all":
        yield Event("region", stopwatch.seconds, 1, 1, note=str(region))
    return region


def find_region(
    text: str,
    scene: Gaussians,
    views: Sequence[View],
    held_out: Sequence[View],
    editor: Editor,
    prompt: str,
    execution: Execution,
    coarse: Coarse | None = None,
) -> Region | None:
    """The region that `text` (see gsedit.regions.parse) names; of the cells of a large scene where
    `scene` is what they are.

    None for `auto` where the editor predicts no subject: see `vote_region`. Raises UsageError and
    InputError as `choose_region` does.
    """
    match spec := parse_region(text):
        case All():
            return everything(scene)
        case Auto():
            return _predicted(scene, views, editor, prompt, execution)
        case Box() | Sphere():
            inside = spec.contains(scene.means)
        case File(path) if path.suffix.lower() == ".npy":
            whole = scene if coarse is None else coarse.fine
            inside = read_flags(path, len(whole))
            inside = inside if coarse is None else coarse.majority(inside)
        case File(path):
            every = (*views, *held_out)
            masks = read_masks(path, every)
            cameras = [every[i].camera for i in masks]
            inside = find_drawn(scene, lift(scene, cameras, list(masks.values()), execution))
    if not inside.any():
        low, high = (
            ", ".join(f"{x:.4g}" for x in corner.tolist())
            for corner in (scene.means.amin(0), scene.means.amax(0))
        )
        raise UsageError(
            f"region {text} holds no Gaussian of the scene, whose centres are from ({low}) to "
            f"({high}): look at it with gsedit render SCENE --region ..."
        )
    return Region(inside, text)


def _predicted(
    scene: Gaussians, views: Sequence[View], editor: Editor, prompt: str, execution: Execution
) -> Region | None:
    """The subject of the instruction, as the editor sees it in small renders of the views."""
    predict = editor.capabilities.predict_subject
    if predict is None:
        return None
    shown = evenly_spaced(len(views), PREDICTED_VIEWS)
    cameras = [_predicted_camera(views[i].camera) for i in shown]
    pictures = [rendering_of(scene, camera, execution).color.clamp(0, 1) for camera in cameras]
    probability = predict(prompt, torch.stack(pictures))
    if probability is None:
        return Region(everything(scene).inside, "auto: the instruction is about the whole scene")
    inside = find_subject(scene, lift(scene, cameras, list(probability), execution))
    if inside is None:
        return Region(everything(scene).inside, "auto: no subject stands out, so it is all")
    return Region(inside, "auto: the subject")


def _predicted_camera(camera: Camera) -> Camera:
    """The same view, its longer side PREDICTED_SIZE pixels."""
    scale = PREDICTED_SIZE / max(camera.width, camera.height)
    return camera.resized(*(max(1, round(scale * side)) for side in (camera.width, camera.height)))


def vote_region(session: Session, step: int, steps: int) -> Iterator[Event]:
    """Find the region from the views edited so far, where `auto` is to and no editor predicts it:
    what the editor changed, voted over the views.
    """
    request, edited = session.request, session.edited
    known = edited.region is not None and not edited.voted
    if known or not edited.answers:
        return
    changes = [_change(answer, session.unedited_image(i)) for i, answer in edited.answers.items()]
    cameras = [request.views[i].camera for i in edited.answers]
    lifted = lift(request.scene, cameras, changes, session.settings.execution)
    inside = find_changed(request.scene, lifted)
    edited.voted = True
    if inside is None:
        whole = everything(request.scene).inside
        edited.region = Region(whole, "auto: the edit is of the whole scene")
    else:
        edited.region = Region(inside, "auto: what the edit changes")
    yield Event("region", session.stopwatch.seconds, step, steps, note=str(edited.region))


def _change(
    edited: Float[Tensor, "h w 3"], original: Float[Tensor, "h w 3"]
) -> Float[Tensor, "h w"]:
    """RMS over the channels."""
    return (edited - original).square().mean(-1).sqrt()
