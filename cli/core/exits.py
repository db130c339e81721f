"""How a command ends: one line that explains it, and an exit code."""

from __future__ import annotations

from gsedit.errors import GseditError, InputError, UsageError

OK, FAILED, USAGE, UNREADABLE, INTERRUPTED = 0, 1, 2, 3, 130
OUT_OF_MEMORY = "out of memory: try a smaller --size, or close other programs"


class Interrupted(Exception):
    """Ctrl-C or `kill`; the message names what is left of the work."""


def explain(error: BaseException) -> tuple[str, int]:
    """One helpful line and the exit code for anything that can end a command."""
    match error:
        case UsageError():
            return one_line(str(error)), USAGE
        case InputError():
            return one_line(str(error)), UNREADABLE
        case GseditError():
            return one_line(str(error)), FAILED
        case Interrupted():
            return one_line(str(error)), INTERRUPTED
        case KeyboardInterrupt():
            return "interrupted; files that were written before are whole", INTERRUPTED
        case MemoryError():
            return OUT_OF_MEMORY, FAILED
        case RuntimeError() if "can't allocate memory" in str(error):  # torch raises this
            return OUT_OF_MEMORY, FAILED
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            reason = error.strerror or one_line(str(error))
            return f"{where}{reason}; check the disk's space and your permissions", FAILED
        case _:
            kind = type(error).__name__
            return (
                f"internal error ({kind}: {one_line(str(error))}); "
                "rerun with --debug and report what it shows",
                FAILED,
            )


def one_line(text: str) -> str:
    return " ".join(text.split())
