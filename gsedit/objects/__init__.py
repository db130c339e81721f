"""Operations on one object of a scene: remove and fill, move, copy, insert, grow, bend."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.objects.bending.bend import Handle, bend
    from gsedit.objects.growth.grow import grow
    from gsedit.objects.placing.insert import insert
    from gsedit.objects.placing.place import place
    from gsedit.objects.placing.placement import Placement, RelativePlace
    from gsedit.objects.removal.remove import remove
    from gsedit.select.click import Click, Selector
    from gsedit.select.phrase import find_phrase
    from gsedit.select.segment import Segments, segment
    from gsedit.surface.depth import point_at

make_lazy(__name__)
