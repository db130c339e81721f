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
    from rasterizer.front import kernel as front

    sources = (cpp_backend.SOURCE, front.SOURCE)
    if any(map(compiled.takes_seconds, sources)):
        print_message("compiling the kernel for this machine, once: about ten seconds")
    made = [compiled.make(source) for source in sources]
    failure = next((each.failure for each in made if each.failure), "")
    if not failure:
        print_message(f"renders with the compiled kernel ({made[0].compiler})")
    elif execution.kernel == "compiled":
        raise UsageError(f"--kernel compiled: {failure}; {compiled.MOVE}, or use --kernel torch")
    else:
        print_message(f"{failure}: renders with torch, slower; {compiled.MOVE}")
