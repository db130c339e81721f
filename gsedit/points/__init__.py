"""The point-cloud tools: select, clean, move, colour and compare splats. They need no torch.

Every operation is a frozen dataclass and a function of the same meaning: the function takes a
`SplatTable` or a `Gaussians` and returns the same kind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.points.decimate import Decimate, decimate
    from gsedit.points.filter import Filter, filter, select
    from gsedit.points.merge import Merge, merge
    from gsedit.points.operation import Operation, Rowwise, Whole, apply
    from gsedit.points.order import Order, order
    from gsedit.points.reduce_sh import ReduceSH, reduce_sh
    from gsedit.points.selection.base import Selection
    from gsedit.points.selection.where import where
    from gsedit.points.transform import Transform, TransformAboutCentre, transform

__all__ = [
    "Decimate",
    "Filter",
    "Merge",
    "Operation",
    "Order",
    "ReduceSH",
    "Rowwise",
    "Selection",
    "Transform",
    "TransformAboutCentre",
    "Whole",
    "apply",
    "decimate",
    "filter",
    "merge",
    "order",
    "reduce_sh",
    "select",
    "transform",
    "where",
]

make_lazy(
    __name__,
    {
        "filter": ("Filter", "filter", "select"),
        "decimate": ("Decimate", "decimate"),
        "merge": ("Merge", "merge"),
        "order": ("Order", "order"),
        "operation": ("Operation", "Rowwise", "Whole", "apply"),
        "reduce_sh": ("ReduceSH", "reduce_sh"),
        "selection.base": ("Selection",),
        "selection.where": ("where",),
        "transform": ("Transform", "TransformAboutCentre", "transform"),
    },
)
