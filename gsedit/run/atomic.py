"""Files that are either written completely or not at all, by one process at a time."""

from __future__ import annotations

import errno
import os
import re
import secrets
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from platform import node

from gsedit.errors import GseditError, UsageError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LONGEST_NAME_BYTES = 255
"""Longest file name of the usual file systems."""
_HOST = f"{zlib.crc32(node().encode()) & 0xFFFF:04x}"
_TEMPORARY = re.compile(r"\.gs-(?:lock|([0-9a-f]{4})-(\d+)-[0-9a-f]{4})\.(.+)", re.DOTALL)
"""Names that `atomic_path` and `locked` make: the machine, the process, any number; the name."""
_PREFIX_BYTES = len(f".gs-{_HOST}-{1 << 22}-{_HOST}.")
_OTHER_PLACE = {
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT, errno.EEXIST, errno.ENOTDIR,
    errno.EISDIR, errno.ENAMETOOLONG, errno.EINVAL, errno.ELOOP,
}  # fmt: skip
"""Errors that are of the place that was asked for, and not of the disk."""
_NO_LINKS = {errno.EPERM, errno.EACCES, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK}
"""Errors of file systems without hard links."""


@contextmanager
def atomic_path(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it there on success, remove it on failure.

    The temporary name ends like the real one, so writers that look at the suffix see the same.
    Parent folders are created, and what killed processes had begun to write of the file is removed.
    Raises UsageError if `path` exists (and not `overwrite`), also where another process wrote it
    meanwhile, is a folder, or cannot be written there; GseditError where the disk fails or is full.
    """
    path = Path(path)
    check_writable(path, overwrite=overwrite)
    # not mkstemp: it ignores the umask, and its files are readable by their owner only
    own = f"{_HOST}-{os.getpid()}-{secrets.token_hex(2)}"
    temporary = path.with_name(f".gs-{own}.{_tail(path.name)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_temporaries(path)
        yield temporary
        with temporary.open("rb+") as file:  # after a power cut the file is not empty
            os.fsync(file.fileno())
        _publish(temporary, path, overwrite)
    except OSError as error:
        raise _not_written(path, error) from error
    finally:
        _remove(temporary)


def check_writable(path: str | Path, *, overwrite: bool = False) -> None:
    """Raise UsageError if `path` is a folder, or exists and not `overwrite`.

    To be called before long work too, whose result could not be written. A link that leads nowhere
    exists.
    """
    path = Path(path)
    if path.is_dir():
        raise UsageError(f"{path} is a folder: name the file to write inside it")
    if os.path.lexists(path) and not overwrite:
        raise _exists(path)


def beside_or_shared(
    own: Path, shared: Path, fits: Callable[[Path], bool], *, overwrite: bool = False
) -> Path:
    """Return where to write what belongs to one scene of a folder: `shared`, or `own` where that
    is there, or where the shared file belongs to another scene (`fits` tells).

    Raises UsageError where the place is taken by something that does not fit, unless `overwrite`.
    """
    is_own = os.path.lexists(own) or (os.path.lexists(shared) and not fits(shared))
    path = own if is_own else shared
    check_writable(path, overwrite=overwrite or fits(path))
    return path


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keep other processes from work on `path`, until the context or this process ends.

    The folder is made, and removed again if it stays empty. Raises UsageError where another process
    holds the path, or the folder cannot be written. On Windows, and on file systems without locks,
    nothing is held.
    """
    place = path.with_name(f".gs-lock.{_tail(path.name)}")
    is_new = not place.parent.exists()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        file = _taken(place)
    except OSError as error:
        raise _not_written(path, error) from error
    if file is None:
        raise UsageError(f"another gsedit is writing {path}: wait for it, or choose another place")
    try:
        yield
    finally:
        if fcntl is not None:
            _remove(place)
        os.close(file)
        _remove(place)  # on Windows not before it is closed
        if is_new:
            with suppress(OSError):  # it holds a result
                place.parent.rmdir()


def is_temporary(name: str) -> bool:
    """Whether it is the name of a file whose writing `atomic_path` began, or of a lock."""
    return _TEMPORARY.match(name) is not None


def remove_temporaries(path: Path) -> None:
    """Remove what processes of this machine that were killed had begun to write of this file."""
    tail = _tail(path.name)
    begun = [name for name in os.listdir(path.parent) if name.startswith(".gs-")]
    for name in begun:
        match = _TEMPORARY.match(name)
        if match and match[3] == tail and match[1] == _HOST and not _runs(int(match[2])):
            _remove(path.with_name(name))


def _tail(name: str) -> str:
    """The end of a name, as long as a temporary name may hold."""
    encoded, most = os.fsencode(name), LONGEST_NAME_BYTES - _PREFIX_BYTES
    return name if len(encoded) <= most else encoded[-most:].decode(errors="ignore")


def _runs(process: int) -> bool:
    if os.name == "nt":  # there, a signal 0 would end it
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True


def _publish(temporary: Path, path: Path, overwrite: bool) -> None:
    """Move a file to its place. Raises UsageError where that is taken, unless `overwrite`."""
    if overwrite:
        temporary.replace(path)
        return
    try:
        if os.name == "nt":
            temporary.rename(path)
        else:
            _link(temporary, path)
    except FileExistsError:
        raise _exists(path) from None


def _link(temporary: Path, path: Path) -> None:
    """Move a file where none is. Raises FileExistsError."""
    try:
        os.link(temporary, path)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        os.close(os.open(path, os.O_CREAT | os.O_EXCL))
        temporary.replace(path)


def _taken(place: Path) -> int | None:
    """The open file of a lock; None where another process holds it."""
    if fcntl is None:
        return os.open(place, os.O_CREAT | os.O_RDWR)
    while True:
        file = os.open(place, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            return None
        except OSError:  # a file system without locks
            return file
        if os.fstat(file).st_nlink:
            return file
        os.close(file)  # its holder removed it meanwhile


def _exists(path: Path) -> UsageError:
    return UsageError(f"{path} already exists: add -f to replace it, or choose another name")


def _not_written(path: Path, error: OSError) -> GseditError:
    """Error to raise for one that occurred while a file was written."""
    kind = UsageError if error.errno in _OTHER_PLACE else GseditError
    reason = error.strerror or f"{error}; the disk may be full"  # a library's error has no number
    return kind(f"{path} cannot be written ({reason}): choose another place with -o")


def _remove(temporary: Path) -> None:
    try:
        temporary.unlink(missing_ok=True)
    except OSError:  # the parent is no folder, so nothing was written
        return
