"""Selections of Gaussians: by volume, value, color, rank, neighbors, views or file.

`where("opacity > 0.1 and not sphere(0, 0, 0, 1)")` makes a selection of an expression; the classes
and functions make the same in Python. They combine with `&`, `|` and `~`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.toolkit.selection.base import EVERYTHING, Selection
    from gsedit.toolkit.selection.clusters import Clusters
    from gsedit.toolkit.selection.inside_mesh import InsideMesh
    from gsedit.toolkit.selection.middle import InTheMiddle
    from gsedit.toolkit.selection.near_color import NearColor
    from gsedit.toolkit.selection.near_selected import Grown, Shrunk
    from gsedit.toolkit.selection.ranked import Amount, Ranked
    from gsedit.toolkit.selection.saved import Flags
    from gsedit.toolkit.selection.seen import Drawn, Seen
    from gsedit.toolkit.selection.values import Column, Compare, Distance, Named, Number
    from gsedit.toolkit.selection.volumes import (
        box,
        cylinder,
        ellipsoid,
        half_space,
        oriented_box,
        sphere,
    )
    from gsedit.toolkit.selection.where import where

make_lazy(__name__)
