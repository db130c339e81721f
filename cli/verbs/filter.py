"""`gsedit filter`: keep the selected Gaussians."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..options.selection import SelectionOptions, need_selection

if TYPE_CHECKING:
    from gsedit.toolkit.filter import Filter


def filter_(*, selection: SelectionOptions) -> Filter:
    """Keep the selected Gaussians and remove the others.

    gsedit filter scene.ply --where "opacity > 0.1 and size < 0.5" -o small.ply

    gsedit filter scene.ply --where "box(-1,-1,-inf, 1,1,inf)" -o inside.ply

    gsedit filter bear.ply --region auto --data photos/ -o bear_alone.ply

    A size is in units of the scene, an opacity and a color from 0 to 1.
    """
    chosen = need_selection(selection, "filter")

    from gsedit.toolkit.filter import Filter

    return Filter(selection=chosen)
