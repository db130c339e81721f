"""Places that a page may read and write: what was given at the start, and the session."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.formats.registry import READABLE

SHOWN = 80
"""Characters of a wrong path that are told."""


@dataclass(frozen=True)
class Places:
    """Folders below which a page may read and write."""

    folders: tuple[Path, ...]
    """Resolved: links in them lead nowhere else."""

    def check(self, path: Path | str) -> Path:
        """The resolved path; a relative one is below the first folder. Raises UsageError for one
        outside of all folders, also by way of a link."""
        text = str(path).strip()
        if not text or "\0" in text:
            raise UsageError("name a file or a folder")
        try:
            resolved = (self.folders[0] / Path(text).expanduser()).resolve()
            resolved.exists()
        except (OSError, RuntimeError) as error:  # a name that is too long, a user that is not
            raise UsageError(f"{text[:SHOWN]} is no path ({error}): check it") from error
        if not any(resolved.is_relative_to(folder) for folder in self.folders):
            raise UsageError(
                f"{text} is outside of {' and '.join(map(str, self.folders))}: give its folder "
                "at the start (gsedit app --allow FOLDER, gsedit mcp FOLDER)"
            )
        return resolved


def free(path: Path) -> Path:
    """A path that is free: this one, or one with a number."""
    known = (each for each in READABLE if each[0] == "." and path.name.lower().endswith(each))
    suffix = max(known, key=len, default=path.suffix)
    stem, number, found = path.name[: -len(suffix)] if suffix else path.name, 1, path
    while found.exists():
        number += 1
        found = path.with_name(f"{stem}-{number}{suffix}")
    return found
