"""Operations on one object of a scene: remove and fill, move, copy, insert, grow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.change.objects.growth.grow import grow
    from gsedit.change.objects.placing.insert import insert
    from gsedit.change.objects.placing.place import place
    from gsedit.change.objects.placing.placement import Placement, RelativePlace
    from gsedit.change.objects.removal.remove import remove

make_lazy(__name__)
