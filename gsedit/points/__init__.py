"""The point-cloud tools: select, clean, move, colour and compare splats. They need no torch.

Every operation is a frozen dataclass and a function of the same meaning: the function takes a
`SplatTable` or a `Gaussians` and returns the same kind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.points.align import align_length, align_to, align_to_ground
    from gsedit.points.background import InTheMiddle, RemoveBackground, remove_background
    from gsedit.points.check import check
    from gsedit.points.clean import Clean, clean
    from gsedit.points.decimate import Decimate, decimate
    from gsedit.points.filter import Filter, filter, select
    from gsedit.points.lod import lod
    from gsedit.points.merge import Merge, merge
    from gsedit.points.operation import Operation, Rowwise, Whole, apply
    from gsedit.points.order import Order, order
    from gsedit.points.palette import Palette, match_palette
    from gsedit.points.recolor import Opacity, Recolor, recolor, set_opacity
    from gsedit.points.reduce_sh import ReduceSH, reduce_sh
    from gsedit.points.repair import Repair, repair
    from gsedit.points.selection.base import Selection
    from gsedit.points.selection.where import where
    from gsedit.points.survey import Limits, survey
    from gsedit.points.transform import Transform, TransformAboutCentre, transform

__all__ = [
    "Clean",
    "Decimate",
    "Filter",
    "InTheMiddle",
    "Limits",
    "Merge",
    "Opacity",
    "Operation",
    "Order",
    "Palette",
    "Recolor",
    "ReduceSH",
    "RemoveBackground",
    "Repair",
    "Rowwise",
    "Selection",
    "Transform",
    "TransformAboutCentre",
    "Whole",
    "align_length",
    "align_to",
    "align_to_ground",
    "apply",
    "check",
    "clean",
    "decimate",
    "filter",
    "lod",
    "match_palette",
    "merge",
    "order",
    "recolor",
    "reduce_sh",
    "remove_background",
    "repair",
    "select",
    "set_opacity",
    "survey",
    "transform",
    "where",
]

make_lazy(
    __name__,
    {
        "background": ("InTheMiddle", "RemoveBackground", "remove_background"),
        "align": ("align_length", "align_to", "align_to_ground"),
        "check": ("check",),
        "clean": ("Clean", "clean"),
        "repair": ("Repair", "repair"),
        "survey": ("Limits", "survey"),
        "filter": ("Filter", "filter", "select"),
        "decimate": ("Decimate", "decimate"),
        "lod": ("lod",),
        "merge": ("Merge", "merge"),
        "order": ("Order", "order"),
        "operation": ("Operation", "Rowwise", "Whole", "apply"),
        "palette": ("Palette", "match_palette"),
        "recolor": ("Opacity", "Recolor", "recolor", "set_opacity"),
        "reduce_sh": ("ReduceSH", "reduce_sh"),
        "selection.base": ("Selection",),
        "selection.where": ("where",),
        "transform": ("Transform", "TransformAboutCentre", "transform"),
    },
)
