"""What a person's sentence asks for, among the looks that the editor `small` knows.

Each name is imported when it is first used; the table of looks loads no torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.words.looks import LOOKS, Look
    from gsedit.words.reader import understand
    from gsedit.words.understanding import ScoredLook, Understanding

__all__ = ["LOOKS", "Look", "ScoredLook", "Understanding", "understand"]

make_lazy(
    __name__,
    {
        "looks": ("LOOKS", "Look"),
        "reader": ("understand",),
        "understanding": ("ScoredLook", "Understanding"),
    },
)
