"""The progress of an edit as a state that a checkpoint holds, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from operator import index
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import Said, UsageError
from gsedit.paper.edit_views import find_ground_truth
from gsedit.paper.session import Session, Work
from gsedit.paper.view_plan import ViewPlan
from gsedit.run.state import State, check_same, restoring, tensor_like
from gsedit.run.stopwatch import Stopwatch
from gsedit.select.region import Region, everything
from gsedit.views.dataset import View

FORMAT = 6
"""Version of an edit's state: raised when older states can no longer be restored."""


def views_state(session: Session) -> State:
    """Everything that asking the 2D editor changes; the tensors are the session's own."""
    edited = session.progress.edited
    tensors = {"generator": session.request.generator.get_state()}
    tensors |= {f"answer.{i}": image for i, image in edited.answers.items()}
    for i, view in edited.targets.items():
        if view.image is not edited.answers.get(i):  # no file holds the same memory twice
            tensors[f"target.{i}"] = view.image
    if edited.region is not None and not edited.region.is_all:
        tensors["region"] = edited.region.inside
    return State(
        {
            "work": asdict(session.progress.work),
            "answers": list(edited.answers),
            "targets": list(edited.targets),
            "pairs": list(edited.pairs),
            "region": None if edited.region is None else edited.region.note,
            "voted": edited.voted,
        },
        tensors,
    )


def session_state(session: Session, views: State | None = None) -> State:
    """Everything that changes during an edit, with the `views` as they are, or were before."""
    progress, views = session.progress, views or views_state(session)
    tensors = {f"optimizer.{name}": each for name, each in progress.optimizer.state().items()}
    return State(
        {
            "edit_format": FORMAT,
            "view_plan": asdict(session.plan),
            "noise_seed": progress.noise_seed,
            "seconds": progress.stopwatch.seconds,
            "stages": dict(progress.stopwatch.stages),
            **views.record,
        },
        tensors | dict(views.tensors),
    )


def check_resumable(state: State, request: Mapping[str, Any]) -> None:
    """Raise UsageError where the state is of another version, or of another `request_record`."""
    if state.record.get("edit_format") != FORMAT:
        what = "the checkpoint of this edit was written by another version of gsedit"
        raise UsageError(Said(what, "begin-again"))
    with restoring(state):
        check_same(request, state.record["request"], "edit")


def view_plan_of(state: State) -> ViewPlan:
    """The plan of views of a state: it is not made again, so that it is certainly the same."""
    with restoring(state):
        plan = state.record["view_plan"]
        batches = tuple(tuple(map(index, batch)) for batch in plan["batches"])
        return ViewPlan(batches, tuple(map(float, plan["coverage"])))


def stopwatch_of(state: State) -> Stopwatch:
    """A stopwatch that goes on from the time that was spent."""
    with restoring(state):
        stages = {name: float(seconds) for name, seconds in state.record["stages"].items()}
        return Stopwatch(state.record["seconds"], stages)


def restore(session: Session, state: State) -> None:
    """Bring a session that has not begun to where the state is."""
    progress, generator = session.progress, session.request.generator
    with restoring(state):
        progress.optimizer.load_state(state.within("optimizer"))
        generator.set_state(tensor_like(state.tensors, "generator", generator.get_state()))
        for name, default in asdict(Work()).items():
            value = state.record["work"][name]
            setattr(progress.work, name, index(value) if type(default) is int else float(value))
        _restore_views(session, state.record, state.tensors)
    if progress.edited.answers:
        find_ground_truth(session, progress.edited.answers)


def _restore_views(
    session: Session, record: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Bring the edited views and the region to where the state is."""
    edited, views = session.progress.edited, session.request.every_view
    edited.answers = {i: _picture(tensors, "answer", i, views) for i in record["answers"]}
    pictures = {
        i: _picture(tensors, "target", i, views) if f"target.{i}" in tensors else edited.answers[i]
        for i in record["targets"]
    }
    edited.targets = {
        i: View(views[i].name, views[i].camera, picture) for i, picture in pictures.items()
    }
    edited.pairs = [(a, b, share) for a, b, share in record["pairs"]]
    edited.voted = record["voted"]
    edited.region = None
    if record["region"] is not None:
        every = everything(session.request.scene).inside
        inside = tensor_like(tensors, "region", every) if "region" in tensors else every
        edited.region = Region(inside, record["region"])


def _picture(
    tensors: Mapping[str, Tensor], name: str, i: int, views: Sequence[View]
) -> Float[Tensor, "h w 3"]:
    """The picture of view i that a checkpoint holds. Raises ValueError for one of another shape."""
    if not 0 <= i < len(views):
        raise ValueError(f"there is no view {i}")
    camera = views[i].camera
    return tensor_like(tensors, f"{name}.{i}", torch.empty(camera.height, camera.width, 3))
