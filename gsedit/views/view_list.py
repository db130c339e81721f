"""Fixed views to measure at: cameras, names, and what an edit did with each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from gsedit.errors import UsageError
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


def with_roles_of(given: ViewList, views: ViewList) -> ViewList:
    """`views` with the roles that `given` gives to those names; "other" where it names none.

    Raises UsageError where it names none of them.
    """
    named: dict[str, Role] = {each.name: role for each, role in zip(given.viewpoints, given.roles)}
    roles: list[Role] = [named.get(viewpoint.name, "other") for viewpoint in views.viewpoints]
    if not any(viewpoint.name in named for viewpoint in views.viewpoints):
        raise UsageError(
            f"none of the listed views ({given.viewpoints[0].name}, ...) is one of these photos "
            f"({views.viewpoints[0].name}, ...): give the list that was made with them"
        )
    return ViewList(views.viewpoints, tuple(roles))
