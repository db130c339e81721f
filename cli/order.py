"""`gsedit order`: sort the rows of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from gsedit.points.order import Order

By = Annotated[
    str,
    typer.Option(
        "--by",
        metavar="morton|importance",
        help="morton: near ones together. importance: opacity times projected area, largest first.",
    ),
]


def order(by: By = "morton") -> Order:
    """Sort the Gaussians: near ones together, or important ones first; nothing else changes.

    gsedit order scene.ply -o sorted.ply
    """
    from gsedit.points.order import Order

    return Order(by)
