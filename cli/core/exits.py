"""How a command ends: one line that explains it, and an exit code."""

from __future__ import annotations

from gsedit.errors import GseditError, InputError, Said, UsageError

OK, FAILED, USAGE, UNREADABLE, INTERRUPTED = 0, 1, 2, 3, 130
OUT_OF_MEMORY = Said("out of memory", "memory")


class Interrupted(Exception):
    """Ctrl-C or `kill`; the message names what is left of the work."""


def explain(error: BaseException) -> tuple[Said, int]:
    """One helpful sentence and the exit code for anything that can end a command."""
    match error:
        case GseditError():
            codes = {UsageError: USAGE, InputError: UNREADABLE}
            code = next((codes[kind] for kind in codes if isinstance(error, kind)), FAILED)
            return error.said.worded(one_line(error.said.what)), code
        case Interrupted():
            return Said(one_line(str(error))), INTERRUPTED
        case KeyboardInterrupt():
            return Said("interrupted; files that were written before are whole"), INTERRUPTED
        case MemoryError():
            return OUT_OF_MEMORY, FAILED
        case RuntimeError() if "can't allocate memory" in str(error):  # torch raises this
            return OUT_OF_MEMORY, FAILED
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            reason = error.strerror or one_line(str(error))
            return Said(f"{where}{reason}; check the disk's space and your permissions"), FAILED
        case _:
            kind = type(error).__name__
            return Said(f"internal error ({kind}: {one_line(str(error))})", "report"), FAILED


def one_line(text: str) -> str:
    return " ".join(text.split())
