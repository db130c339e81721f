"""Message that names the kernel, printed once before a command renders."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from gsedit.errors import UsageError
from rasterizer.numerics import Execution, rule

from .console import print_message

Part = Literal["blending", "projection", "optimizer", "loss"]
RENDERS: tuple[Part, ...] = ("blending", "projection")
UPDATES: tuple[Part, ...] = (*RENDERS, "optimizer")
FITS: tuple[Part, ...] = (*UPDATES, "loss")
SECONDS = 3
"""To compile one file: 0.5 to 3.7 on a Xeon core."""


def say_kernel(execution: Execution, parts: tuple[Part, ...] = RENDERS) -> None:
    """Let an execution rule what the command renders, and print whether compiled kernels do its
    parts; they are compiled where they are not yet. Raises UsageError where they are asked for and
    cannot render."""
    rule(execution)
    if execution.kernel == "torch":
        return
    from rasterizer import compiled

    files = sources(parts)
    if missing := sum(map(compiled.takes_seconds, files.values())):
        print_message(
            f"compiling {missing} C++ file{'s' if missing > 1 else ''} for this machine, once: "
            f"about {SECONDS * missing} seconds"
        )
    made = {part: compiled.make(file) for part, file in files.items()}
    failed = [part for part in parts if made[part].failure]
    if note := next((each.note for each in made.values() if each.note), ""):
        print_message(note)
    if not failed:
        print_message(f"renders with the compiled kernel ({made['blending'].compiler})")
        return
    failure, move = made[failed[0]].failure, made[failed[0]].move
    if execution.kernel == "compiled" and failed[0] in RENDERS:
        raise UsageError(f"--kernel compiled: {failure}; {move}, or use --kernel torch")
    if "blending" in failed:
        print_message(f"{failure}: renders with torch, slower; {move}")
    else:
        print_message(
            f"{failure}: torch does the {' and the '.join(failed)}, slower; the compiled kernel "
            f"({made['blending'].compiler}) does the rest; {move}"
        )


def sources(parts: tuple[Part, ...]) -> dict[Part, Path]:
    """Return the C++ file of each part."""
    from gsedit.capture.fitting import adam, photometric
    from rasterizer.blending import cpp_backend
    from rasterizer.cpp_projection import kernel as front

    files: dict[Part, Path] = {
        "blending": cpp_backend.SOURCE,
        "projection": front.SOURCE,
        "optimizer": adam.SOURCE,
        "loss": photometric.SOURCE,
    }
    return {part: files[part] for part in parts}
