"""Selections of Gaussians: by value, volume, color or view; said, clicked, drawn or saved.

`where("opacity > 0.1 and not sphere(0, 0, 0, 1)")` makes a selection of an expression; its
functions, in `gsedit.select.kinds`, make the same in Python.
Selections combine with `&`, `|` and `~`. A `Finder` answers expressions that look at a scene:
`Finder(scene).select("subject()")` is a `Region`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.select.click import Click, Selector
    from gsedit.select.finder import Finder, Names
    from gsedit.select.phrase import find_phrase
    from gsedit.select.region import Region
    from gsedit.select.segment import Segments, segment
    from gsedit.select.selection import Selection
    from gsedit.select.subject import find_subject
    from gsedit.select.where import where

make_lazy(__name__)
