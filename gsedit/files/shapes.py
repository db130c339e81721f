"""jaxtyping's array types for the modules that `gsedit info` needs at its start.

To import jaxtyping takes 0.08 s, a fifth of what a command may take to start; where nothing checks
types, nobody reads the annotations. Whoever checks them has imported it before.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float32
else:

    class Unchecked:
        """Stands for an array of any shape."""

        def __class_getitem__(cls, item: Any) -> Any:
            return item[0]

    Bool = Float32 = Unchecked

__all__ = ["Bool", "Float32"]
