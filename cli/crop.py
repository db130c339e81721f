"""`gsedit crop`: keep what is inside volumes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .selection_options import VolumeOptions, need_selection

if TYPE_CHECKING:
    from gsedit.points.filter import Filter


def crop(*, selection: VolumeOptions) -> Filter:
    """Keep what is inside a box, a sphere or another volume: filter, with the volumes alone.

    gsedit crop scene.ply --box -1,-1,-,1,1,- -o inside.ply

    Of several volumes, what is inside all is kept.
    """
    chosen = need_selection(selection, "crop")

    from gsedit.points.filter import Filter

    return Filter(selection=chosen)
