"""Object route: remove, scale, turn, move, copy, let things grow, put a file's scene in.

`n` Gaussians before, `m` after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.change import objects
from gsedit.change.objects.placing.placement import Placement, RelativePlace, Side
from gsedit.editing.plan import COPY, key_of
from gsedit.errors import Said, UsageError
from gsedit.formats.scenes import load
from gsedit.scene.outcome import Outcome
from gsedit.select.finder import Finder
from gsedit.views.cameras_json import cameras_file, read_cameras
from gsedit.views.paths import up_of
from gsedit.views.viewpoints import that_see
from gsedit.words.instruction import Change, Place
from gsedit.words.phrases import GROUNDS
from gsedit.words.refusals import REASONS
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

Flags = Mapping[str, Bool[Tensor, " n"]]
"""Flags of the Gaussians of what a change can name, by `key_of` and by phrase."""
OFFSETS = {
    "left": (-1, 0, 0), "right": (1, 0, 0), "forward": (0, -1, 0), "back": (0, 1, 0),
    "down": (0, 0, -1), "up": (0, 0, 1),
}  # fmt: skip
"""Right, back and up of each way to go."""


def paint_objects(
    scene: Gaussians,
    run: Sequence[Change],
    flags: Flags,
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
) -> Outcome:
    """Make a run of changes of one object: what is done at once, see `runs_of`.

    Raises UsageError where what changes is empty or the whole scene, and as the operations do;
    InputError for a file that holds no scene.
    """
    change = run[0]
    if change.name == "insert":
        return _insert(scene, run, flags, cameras, execution)
    inside = flags[key_of(change)]
    if change.kind == "growth":
        _check(change, inside, whole=True)
        among = None if inside.all() else inside
        return objects.grow(scene, change.name, 1 + (change.amount or 0), among, cameras, execution)
    _check(change, inside, whole=change.name in (COPY, "scale", "turn"))
    if change.name == "remove" and change.target == "background":
        return _without(scene, inside)
    if change.name == "remove":
        return objects.remove(scene, inside, cameras, execution)
    if any(each.place is not None and each.place.metres for each in run):
        raise UsageError(REASONS["distance"])
    if change.name == COPY and (change.amount or 1) > 1:
        raise UsageError(REASONS["copies"])
    placement = Placement()
    for each in run:
        placement = _placed(placement, each, flags, key_of(change))
    return objects.place(scene, inside, placement, cameras, execution)


def _check(change: Change, inside: Bool[Tensor, " n"], *, whole: bool) -> None:
    """Raise UsageError for no Gaussians, and for all of them unless `whole` may be."""
    if not inside.any():
        raise UsageError(Said(f"{change}: nothing of it is in the scene", "select-object"))
    if inside.all() and not whole:
        raise UsageError(Said(f"{change}: the region is the whole scene", "select-less"))


def _without(scene: Gaussians, inside: Bool[Tensor, " n"]) -> Outcome:
    """The scene without some Gaussians; nothing is filled."""
    rows = torch.nonzero(~inside).flatten()
    return Outcome(
        scene[rows], rows, torch.zeros(len(rows), dtype=torch.bool),
        (f"{int(inside.sum()):,} Gaussians are left out, nothing is put in their place",),
    )  # fmt: skip


def _placed(placement: Placement, change: Change, flags: Flags, own: str) -> Placement:
    """A placement with one change more; `own` is the key of what is placed."""
    amount, to = change.amount or 0.0, change.place
    if change.name == "scale":
        return replace(placement, scale=1 + amount)
    if change.name == "turn":
        return replace(placement, turn=360 * amount)
    if to is None or to.of:
        return replace(placement, to=_beside(to, flags, own), copy=change.name == COPY)
    far = 0.5 if change.amount is None else amount  # of its size: plainly seen, and still in view
    right, back, up = (far * each for each in OFFSETS[to.side])
    return replace(placement, offset=(right, back, up), unit=1.0 if to.units else None)


def _beside(place: Place | None, flags: Flags, own: str | None) -> RelativePlace | None:
    """The place as `gsedit.change.objects.placing` has it; `own` is the key of what is placed."""
    if place is None:
        return None
    of = "subject" if place.of == "it" else place.of
    side = cast("Side", place.side)  # a place of something is no mere way
    return RelativePlace(side, None if of == own else flags[of])


def _insert(
    scene: Gaussians,
    run: Sequence[Change],
    flags: Flags,
    cameras: Sequence[Camera],
    execution: Execution,
) -> Outcome:
    """The scene with the object of a file put in.

    It is the subject, and upright, as the cameras beside its file see it, if there are some.
    """
    change, turn = run[0], 360 * sum(each.amount or 0.0 for each in run[1:])
    where, beside = change.place, cameras_file(change.phrase)
    other, up = load(change.phrase), None
    if beside is not None:
        viewpoints = that_see(read_cameras(beside), other, execution)
        if viewpoints:
            up = up_of([each.camera for each in viewpoints])
            other = other[Finder(other, viewpoints, execution=execution).subject.inside]
    if where and where.side == "on" and where.of in GROUNDS:
        where = None  # anywhere on it, not its middle
    at = _beside(where, flags, None)
    return objects.insert(scene, other, at, cameras, execution, turn=turn, up=up)
