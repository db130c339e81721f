"""jaxtyping's array types, and torch's, for modules that commands and a shell's Tab import at once.

To import jaxtyping takes 0.08 s, a fifth of what a command may take to start; where nothing checks
types, nobody reads the annotations. Whoever checks them has imported it before.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float, Float32, Float64, Int, Int64, UInt64
else:

    class Unchecked:
        """Stands for an array of any shape."""

        def __class_getitem__(cls, item: Any) -> Any:
            return item[0]

    Bool = Float = Float32 = Float64 = Int = Int64 = UInt64 = Unchecked

if TYPE_CHECKING or "torch" in sys.modules:
    from torch import Tensor
else:
    Tensor = Any

__all__ = ["Bool", "Float", "Float32", "Float64", "Int", "Int64", "Tensor", "UInt64"]
