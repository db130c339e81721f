"""Where views are taken from: a dataset's cameras, or cameras placed around a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Data, Size

if TYPE_CHECKING:
    from torch import Tensor

Up = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="AXIS",
        show_default="normal of the ground if one is found, else -y",
        help="World axis that points up: x, -x, y, -y, z or -z.",
    ),
]


@dataclass(frozen=True)
class ViewOptions:
    """The cameras of a verb that needs several."""

    data: Data = None
    size: Size = 256
    up: Up = None


def check_axis(up: str | None) -> None:
    """Raise UsageError for a name that is no axis: before a large file is read."""
    up_vector(up)


def up_vector(up: str | None) -> Tensor | None:
    """The unit vector of an axis name; None where the library is to find it from the scene."""
    if up is None:
        return None
    from gsedit.views import framing

    return framing.up_vector(up)
