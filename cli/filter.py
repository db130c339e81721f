"""`gsedit filter`: keep what is selected."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .selection_options import SelectionOptions, need_selection

if TYPE_CHECKING:
    from gsedit.points.filter import Filter


def filter_(*, selection: SelectionOptions) -> Filter:
    """Keep the Gaussians that all options select, and leave out the others.

    gsedit filter scene.ply --min-opacity 0.1 --where "size < 0.5 or near(#a08050, 10)" -o small.ply

    A size is in units of the scene, an opacity and a colour from 0 to 1. docs/selection.md has
    every form.
    """
    chosen = need_selection(selection, "filter")

    from gsedit.points.filter import Filter

    return Filter(selection=chosen)
