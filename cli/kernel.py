"""What renders: said once, before a command renders."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .console import print_message

if TYPE_CHECKING:
    from rasterizer.numerics import Execution


def say_kernel(execution: Execution) -> None:
    """Print whether the compiled kernel renders; it is compiled where it is not yet. Raises
    UsageError where it is asked for and cannot be made."""
    if execution.kernel == "torch":
        return
    from gsedit.errors import UsageError
    from rasterizer import compiled
    from rasterizer.blending import cpp_backend

    library, compiler, failure = compiled.make(cpp_backend.SOURCE)
    if library is not None:
        print_message(f"renders with the compiled kernel ({compiler})")
    elif execution.kernel == "compiled":
        raise UsageError(f"--kernel compiled: {failure}; {compiled.MOVE}, or use --kernel torch")
    else:
        print_message(f"{failure}: renders with torch, slower; {compiled.MOVE}")
