"""`gsedit convert`: the same scene in another format, order or SH degree."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ..chain import Target
from ..core.command import argument, flag, option

Out = Annotated[
    Path | None,
    argument("OUT", "Scene to write; its suffix is the format. May be given as -o OUT."),
]
Order = Annotated[
    str | None,
    flag(
        "--order",
        "Sort the rows. morton: neighbors together. importance: largest opacity times projected "
        "area first.",
        "morton|importance",
    ),
]


@dataclass(frozen=True)
class ConvertOptions:
    """Options of `gsedit convert` alone."""

    degree: int | None = option(
        None,
        "Drop the bands of spherical harmonics above this degree: a smaller file, less gloss.",
        "N",
        min=0,
        max=4,
        flags="--sh-degree",
    )
    undo_dataparser: Path | None = option(
        None,
        "Bring a scene that nerfstudio exported back into the frame of its photos: its "
        "dataparser_transforms.json.",
        "JSON",
    )


def convert(target: Out = None, order: Order = None, *, own: ConvertOptions) -> list[Any]:
    """Write a scene in another format, order or SH degree.

    The suffix of OUT is the format. The command prints what that format cannot hold. A mesh or a
    point cloud becomes Gaussians. SCENE may also be the checkpoint of an interrupted edit or fit.

    gsedit convert scene.ply scene.spz

    gsedit convert scene.ply --order morton --sh-degree 1 -o small.ply

    gsedit convert out/bronze so_far.ply
    """
    steps: list[Any] = []
    if own.undo_dataparser is not None:
        from gsedit.datasets.export_frame import NAME, read_dataparser
        from gsedit.toolkit.transform import transform_of

        steps += [transform_of(read_dataparser(own.undo_dataparser).inverse), Target(target, NAME)]
    else:
        steps.append(Target(target))
    if own.degree is not None:
        from gsedit.toolkit.reduce_sh import ReduceSH

        steps.append(ReduceSH(own.degree))
    if order is not None:
        from gsedit.toolkit.decimate import Order

        steps.append(Order(order))
    return steps
