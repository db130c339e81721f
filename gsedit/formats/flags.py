"""One flag a Gaussian, in the order of the scene's file: a .npy file of booleans."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError

import numpy as np

from gsedit.errors import InputError
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file
from gsedit.scene.shapes import Bool

MAGIC = b"\x93NUMPY\x01\x00"


def read_flags(path: Path | str, count: int) -> Bool[np.ndarray, " n"]:
    """The flags of a .npy file, booleans or numbers (0: outside) for `count` Gaussians.

    Raises InputError for a file that is missing, damaged, or of another number of Gaussians.
    """
    try:
        flags = mapped_array(existing_file(path))
    except (ValueError, EOFError, OSError, OverflowError, SyntaxError, TokenError) as error:
        raise InputError(
            f"{path} is no readable .npy file ({error}): save one flag a Gaussian with numpy.save"
        ) from None
    if flags.dtype.kind not in "biuf":
        raise InputError(f"{path} holds no flags: save one boolean a Gaussian with numpy.save")
    if flags.shape != (count,):
        raise InputError(
            f"{path} has flags of shape {flags.shape} and the scene has {count} Gaussians: a "
            "region belongs to the scene that it was made for"
        )
    return np.asarray(flags != 0)


def mapped_array(path: Path) -> np.ndarray:
    """The array of a .npy file, whose values are read when they are used.

    Raises what numpy.load raises, and ValueError for another version than 1.0: the header of a
    later one, which simple arrays do not need, may claim gigabytes.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin as a .npy file of version 1.0")
    return np.load(path, mmap_mode="r", allow_pickle=False)


def write_flags(flags: np.ndarray, path: Path | str, *, overwrite: bool = False) -> None:
    """Write flags, or numbers. Raises UsageError where the file exists (and not `overwrite`)."""
    with atomic_path(path, overwrite=overwrite) as temporary, temporary.open("wb") as handle:
        np.save(handle, flags)
