"""Where an edit is, so that it can go on from there: what changes, and what it was asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, replace
from itertools import chain
from typing import Any

import torch
from torch import Tensor

from gsedit.files.state import State, digest, digest_of
from gsedit.fitting.crops import ListedCrops
from gsedit.regions.region import Region, everything
from gsedit.reports.json_lines import plain
from gsedit.reports.stopwatch import Stopwatch
from gsedit.session.edit_views import find_ground_truth
from gsedit.session.session import EditedViews, Request, Session, Work
from gsedit.views.dataset import View
from gsedit.views.plan import ViewPlan
from rasterizer.scene import Gaussians

FREE = ("checkpoint_seconds", "execution", "held_out_edits")
"""Settings that may change when an edit goes on: they do not change the scene."""
PLACES = 5
"""Decimals of a camera that identify it: a found one may differ by rounding."""


def requested(request: Request, strategy: Any, strategy_name: str) -> dict[str, Any]:
    """What was asked for, as JSON has it: an edit goes on where this is the same."""
    settings = plain(request.settings)
    return {
        "scene": f"{len(request.scene)} Gaussians, {digest(*_fields(request.scene).values())}",
        "instruction": request.prompt,
        "settings": {name: value for name, value in settings.items() if name not in FREE},
        "strategy": {"name": strategy_name, **plain(strategy)},
        "editor": request.editor.name,
        "views": _described((*request.views, *request.held_out), request.settings.condition),
        "seed": request.generator.initial_seed(),
    }


def _described(views: Sequence[View], condition: str) -> str:
    """Their number and size, and a digest of their cameras; of the pictures too if they count."""
    cameras = [view.camera for view in views]
    poses = torch.stack([camera.world_to_camera.double() for camera in cameras])
    lenses = torch.tensor([[c.fx, c.fy, c.cx, c.cy] for c in cameras], dtype=torch.float64)
    levels = ((255 * view.image).round().byte() for view in views if condition == "photo")
    rounded = [each.round(decimals=PLACES) for each in (poses, lenses)]
    found = digest_of(chain(rounded, levels))
    return f"{len(views)} of {cameras[0].width}x{cameras[0].height}, {found}"


def session_state(session: Session) -> State:
    """All that changes during an edit; the tensors are the session's own."""
    edited = session.edited
    tensors = {f"optimiser.{name}": each for name, each in session.optimiser.state().items()}
    if isinstance(session.crops, ListedCrops):
        tensors |= {f"met.{name}": each for name, each in session.crops.state().items()}
    tensors["generator"] = session.request.generator.get_state()
    tensors |= {f"answer.{i}": image for i, image in edited.answers.items()}
    for i, view in edited.targets.items():
        if view.image is not edited.answers.get(i):  # no file holds the same memory twice
            tensors[f"target.{i}"] = view.image
    if edited.region is not None and not edited.region.is_all:
        tensors["region"] = edited.region.inside
    return State(
        {
            "plan": asdict(session.surveyed.plan),
            "noise_seed": session.noise_seed,
            "work": asdict(session.work),
            "seconds": session.stopwatch.seconds,
            "stages": dict(session.stopwatch.stages),
            "answers": list(edited.answers),
            "targets": list(edited.targets),
            "pairs": edited.pairs,
            "region": None if edited.region is None else edited.region.note,
            "voted": edited.voted,
        },
        tensors,
    )


def planned(state: State) -> ViewPlan:
    """The plan of views: not made again, so that it is certainly the same."""
    plan = state.record["plan"]
    return ViewPlan(tuple(map(tuple, plan["rounds"])), tuple(plan["coverage"]))


def stopwatch_of(state: State) -> Stopwatch:
    """Goes on from the time that was spent."""
    return Stopwatch(state.record["seconds"], state.record["stages"])


def restore(session: Session, state: State) -> None:
    """Bring a session that has not begun to where the state is."""
    session.optimiser.load_state(state.within("optimiser"))
    if isinstance(session.crops, ListedCrops):
        session.crops.load_state(state.within("met"))
    session.request.generator.set_state(state.tensors["generator"])
    for name, value in state.record["work"].items():
        setattr(session.work, name, value)
    _restore_views(session, state.record, state.tensors)
    if pictures := session.edited.answers or _drawn(session):
        find_ground_truth(session, pictures)


def _drawn(session: Session) -> dict[int, Tensor]:
    """Of a strategy that asks the editor's network and edits no picture: the planned views as the
    scene is now."""
    if not session.work.evaluations:
        return {}
    views = session.surveyed.plan.views
    return dict(zip(views, session.render(session.views[i].camera for i in views)))


def _restore_views(
    session: Session, record: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    edited = session.edited
    edited.answers = {i: tensors[f"answer.{i}"] for i in record["answers"]}
    pictures = {
        i: tensors[f"target.{i}"] if f"target.{i}" in tensors else edited.answers[i]
        for i in record["targets"]
    }
    views = session.views
    edited.targets = {
        i: View(views[i].name, views[i].camera, picture) for i, picture in pictures.items()
    }
    edited.pairs = [(a, b, share) for a, b, share in record["pairs"]]
    edited.voted = record["voted"]
    edited.region = None
    if record["region"] is not None:
        inside = tensors.get("region", everything(session.request.scene).inside)
        edited.region = Region(inside, record["region"])


def _fields(scene: Gaussians) -> dict[str, Tensor]:
    return {name: getattr(scene, name) for name in scene.__dataclass_fields__}


class Before:
    """What asking the 2D editor changes of a session, as it was before; pictures are not copied."""

    def __init__(self, session: Session) -> None:
        edited = session.edited
        self.generator = session.request.generator.get_state()
        self.work = astuple(session.work)
        self.edited = replace(
            edited,
            targets=dict(edited.targets),
            answers=dict(edited.answers),
            pairs=list(edited.pairs),
        )

    def restore(self, session: Session) -> None:
        """Undo what was done to the edited views, the generator and the counts."""
        session.request.generator.set_state(self.generator)
        for name, value in zip(Work.__dataclass_fields__, self.work):
            setattr(session.work, name, value)
        for name in EditedViews.__dataclass_fields__:
            setattr(session.edited, name, getattr(self.edited, name))
