"""The point-cloud tools: select, clean, move, color and compare splats. They need no torch.

Every operation is a frozen dataclass. `apply` does them to a `SplatTable` or a `Gaussians` and
returns the same kind; the most frequent ones are functions too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.select.selection import Selection
    from gsedit.select.where import where
    from gsedit.toolkit.align import AlignLength, AlignTo, AlignToGround
    from gsedit.toolkit.clean import Clean, Repair, clean, repair
    from gsedit.toolkit.decimate import Decimate, Order
    from gsedit.toolkit.defects import Limits, check, find_defects
    from gsedit.toolkit.filter import Filter, filter, select
    from gsedit.toolkit.merge import Merge, merge
    from gsedit.toolkit.operation import Operation, Whole, apply
    from gsedit.toolkit.recolor import Opacity, Palette, Recolor, recolor
    from gsedit.toolkit.reduce_sh import ReduceSH
    from gsedit.toolkit.transform import Transform, transform

make_lazy(__name__)
