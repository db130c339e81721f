"""The point-cloud tools: select, clean, move, color and compare splats. They need no torch.

Every operation is a frozen dataclass and a function of the same meaning: the function takes a
`SplatTable` or a `Gaussians` and returns the same kind.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.toolkit.align import align_length, align_to, align_to_ground
    from gsedit.toolkit.check import check
    from gsedit.toolkit.clean import Clean, clean
    from gsedit.toolkit.decimate import Decimate, decimate, lod
    from gsedit.toolkit.filter import Filter, filter, select
    from gsedit.toolkit.find_defects import Limits, find_defects
    from gsedit.toolkit.merge import Merge, merge
    from gsedit.toolkit.operation import Operation, Rowwise, Whole, apply
    from gsedit.toolkit.order import Order, order
    from gsedit.toolkit.palette import Palette, match_palette
    from gsedit.toolkit.recolor import Opacity, Recolor, recolor, set_opacity
    from gsedit.toolkit.reduce_sh import ReduceSH, reduce_sh
    from gsedit.toolkit.repair import Repair, repair
    from gsedit.toolkit.selection.base import Selection
    from gsedit.toolkit.selection.middle import InTheMiddle
    from gsedit.toolkit.selection.where import where
    from gsedit.toolkit.transform import Transform, TransformAboutCenter, transform

make_lazy(__name__)
