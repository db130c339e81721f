"""Fixed views to measure at: cameras, names, and what an edit did with each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from gsedit.views.viewpoints import Viewpoint

Role = Literal["edited", "held_out", "other"]
"""edited: the scene was fitted to pictures of this view. held_out: it was not, and is measured
here. other: neither; a neighbour, with which renders are compared."""
ROLES: tuple[Role, ...] = get_args(Role)
HELD_OUT_EVERY = 8
"""Of a capture of which nothing else is known, as `Dataset.split`."""


@dataclass(frozen=True, eq=False)
class ViewList:
    """Named cameras, each with its role."""

    viewpoints: tuple[Viewpoint, ...]
    roles: tuple[Role, ...]

    def __len__(self) -> int:
        return len(self.viewpoints)

    def having(self, role: Role) -> tuple[int, ...]:
        """The indices of the views with that role."""
        return tuple(i for i, each in enumerate(self.roles) if each == role)


def by_capture(viewpoints: Sequence[Viewpoint]) -> ViewList:
    """Every 8th view held out, as `gsedit fit` and `gsedit edit` do, the others edited."""
    roles: list[Role] = [
        "edited" if i % HELD_OUT_EVERY else "held_out" for i in range(len(viewpoints))
    ]
    return ViewList(tuple(viewpoints), tuple(roles))


def by_edit(viewpoints: Sequence[Viewpoint], edited: Collection[str]) -> ViewList:
    """Of an edit: `edited` names the views that were edited; every 8th view was held out, unless
    there was no other to be edited."""
    roles: list[Role] = []
    for role, viewpoint in zip(by_capture(viewpoints).roles, viewpoints):
        own: Role = "held_out" if role == "held_out" else "other"
        roles.append("edited" if viewpoint.name in edited else own)
    return ViewList(tuple(viewpoints), tuple(roles))
