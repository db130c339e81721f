"""Files that are either written completely or not at all."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsedit.errors import UsageError

_TEMPORARY = re.compile(r"\.[0-9a-f]{8}\..")
"""Names that `atomic_path` makes."""


@contextmanager
def atomic_path(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there on success, remove it on failure.

    The temporary name ends like the real one, so writers that look at the suffix see the same.
    Parent folders are created. Raises UsageError if `path` exists (and not `overwrite`), is a
    folder, or cannot be written.
    """
    path = Path(path)
    check_writable(path, overwrite=overwrite)
    # not mkstemp: it ignores the umask, and its files are readable by their owner only
    temporary = path.with_name(f".{secrets.token_hex(4)}.{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written ({error.strerror or error}): choose another place with -o"
        ) from error
    finally:
        _remove(temporary)


def check_writable(path: str | Path, *, overwrite: bool = False) -> None:
    """Raise UsageError if `path` is a folder, or exists and not `overwrite`.

    To be called before long work too, whose result could not be written.
    """
    path = Path(path)
    if path.is_dir():
        raise UsageError(f"{path} is a folder: name the file to write inside it")
    if path.exists() and not overwrite:
        raise UsageError(f"{path} already exists: add -f to replace it, or choose another name")


def is_temporary(name: str) -> bool:
    """Whether it is the name of a file whose writing `atomic_path` began."""
    return _TEMPORARY.match(name) is not None


def remove_temporaries(path: Path) -> None:
    """Remove what processes that were killed had begun to write of this file."""
    for each in path.parent.glob(f".*.{path.name}"):
        if is_temporary(each.name):
            _remove(each)


def _remove(temporary: Path) -> None:
    try:
        temporary.unlink(missing_ok=True)
    except OSError:  # the parent is no folder, so nothing was written
        return
