"""Which Gaussians of a scene are meant: by volume, value, colour, rank, neighbours, views, file.

`where("opacity > 0.1 and not sphere(0, 0, 0, 1)")` makes a selection of an expression; the classes
make the same in Python. They combine with `&`, `|` and `~`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.points.selection.base import EVERYTHING, Selection
    from gsedit.points.selection.clusters import Clusters
    from gsedit.points.selection.inside_mesh import InsideMesh
    from gsedit.points.selection.near_color import NearColor
    from gsedit.points.selection.near_selected import Grown, Shrunk
    from gsedit.points.selection.ranked import Amount, Ranked
    from gsedit.points.selection.saved import Flags
    from gsedit.points.selection.seen import Drawn, Seen
    from gsedit.points.selection.values import Column, Compare, Distance, Named, Number
    from gsedit.points.selection.volumes import (
        Box,
        Cylinder,
        Ellipsoid,
        HalfSpace,
        OrientedBox,
        Sphere,
    )
    from gsedit.points.selection.where import where

__all__ = [
    "EVERYTHING",
    "Amount",
    "Box",
    "Clusters",
    "Column",
    "Compare",
    "Cylinder",
    "Distance",
    "Drawn",
    "Ellipsoid",
    "Flags",
    "Grown",
    "HalfSpace",
    "InsideMesh",
    "Named",
    "NearColor",
    "Number",
    "OrientedBox",
    "Ranked",
    "Seen",
    "Selection",
    "Shrunk",
    "Sphere",
    "where",
]

make_lazy(
    __name__,
    {
        "base": ("EVERYTHING", "Selection"),
        "clusters": ("Clusters",),
        "inside_mesh": ("InsideMesh",),
        "near_color": ("NearColor",),
        "near_selected": ("Grown", "Shrunk"),
        "ranked": ("Amount", "Ranked"),
        "saved": ("Flags",),
        "seen": ("Drawn", "Seen"),
        "values": ("Column", "Compare", "Distance", "Named", "Number"),
        "volumes": ("Box", "Cylinder", "Ellipsoid", "HalfSpace", "OrientedBox", "Sphere"),
        "where": ("where",),
    },
)
