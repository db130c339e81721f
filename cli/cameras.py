"""Where pictures are taken from: a dataset's cameras, or cameras placed around a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from torch import Tensor

    from rasterizer.camera import Camera
    from rasterizer.scene import Gaussians

Up = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="AXIS",
        show_default="off the ground, or -y",
        help="Which way is up: x, -x, y, -y, z or -z.",
    ),
]


def check_axis(up: str | None) -> None:
    """Raise UsageError for an axis that is none, before a large file is read for it."""
    up_vector(up)


def up_vector(up: str | None) -> Tensor | None:
    """The axis that was named; None where the scene itself must tell."""
    if up is None:
        return None
    from gsedit.views import framing

    return framing.up_vector(up)


def around(scene: Gaussians, count: int, size: int, up: str | None) -> dict[str, Camera]:
    """Named cameras on a circle around a scene that came without any."""
    from gsedit.views.orbit import orbit, orbit_names

    return dict(zip(orbit_names(count), orbit(scene, count, size, up=up_vector(up))))
