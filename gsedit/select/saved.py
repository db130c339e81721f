"""Selections with a name, kept beside a scene file: bear.regions/chair.npy of bear.ply.

Behind its flags, which numpy.load reads alone, a file has a digest of the scene that it is of.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsedit.errors import InputError, UsageError
from gsedit.formats.flags import read_flags
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import beside
from gsedit.words.lexicon import things

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _-]{0,63}")
"""Letters, digits, blanks, _ and -: no suffix, no path, no colon, as the other regions have."""
OWNERS = re.compile(r"(?:(?:the|a|an|this|that|these|those|my|our|your|its|his|her|their) )+(?=.)")
"""Words before a name that are no part of it: "the chair", "my chair"."""
MARK = b"\nscene "
"""Bytes between flags and digest."""


def key_of_name(name: str) -> str:
    """The spelling by which names are compared: "The left_leg-2" is "left leg 2"."""
    return OWNERS.sub("", re.sub(r"[\s_-]+", " ", name.lower()).strip(), count=1)


def check_name(name: str) -> str:
    """The name of a selection without blanks around it. Raises UsageError for what is none."""
    name = name.strip()
    if not NAME.fullmatch(name):
        raise UsageError(
            f"{name!r} is no name for a selection: give letters, digits, blanks, - or _"
        )
    if key_of_name(name) in things("taken"):
        raise UsageError(
            f"{name!r} is no name for a selection: sentences mean something else by it; give the "
            "name of the thing, as in --as chair"
        )
    return name


def folder_of(scene: str | Path) -> Path:
    """The folder of the saved selections of a scene file; it may not exist."""
    return beside(Path(scene), "regions")


def saved_names(scene: str | Path) -> tuple[str, ...]:
    """The names of the selections saved beside a scene file, sorted."""
    return tuple(sorted(path.stem for path in folder_of(scene).glob("*.npy")))


def saved_files(scene: str | Path) -> dict[str, Path]:
    """The .npy files of the selections saved beside a scene file, by `key_of_name`."""
    return {key_of_name(each): folder_of(scene) / f"{each}.npy" for each in saved_names(scene)}


def saved_file(scene: str | Path, name: str) -> Path | None:
    """The .npy file of a saved selection, by its name however spelt; None where there is none."""
    return saved_files(scene).get(key_of_name(name))


def save_named(
    inside: Bool[np.ndarray, " n"],
    means: Float[np.ndarray, "n 3"],
    scene: str | Path,
    name: str,
    *,
    overwrite: bool = False,
) -> Path:
    """Save flags of the scene with these centers beside its file; the path of the selection.

    Raises UsageError for what is no name, or one that exists, unless `overwrite`.
    """
    path = saved_file(scene, name) or folder_of(scene) / f"{check_name(name)}.npy"
    if path.exists() and not overwrite:
        raise UsageError(f"the selection {name} of {scene} exists: add --force to replace it")
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path, overwrite=overwrite) as temporary, temporary.open("wb") as handle:
        np.save(handle, inside)
        handle.write(MARK + digest_of(means))
    return path


def digest_of(means: Float[np.ndarray, "n 3"]) -> bytes:
    """A digest of the centers of a scene's Gaussians, in their order."""
    return hashlib.blake2b(means.astype("<f4").tobytes(), digest_size=16).hexdigest().encode()


def read_named(path: Path, means: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """The flags of a saved selection of the scene with these centers.

    A file without a digest need but have as many flags. Raises InputError for a file that is
    damaged, or of another scene or of other places of its rows.
    """
    flags = read_flags(path, len(means))
    _, mark, digest = path.read_bytes()[-len(MARK) - 32 :].rpartition(MARK)
    if mark and digest != digest_of(means):
        raise InputError(
            f"{path}: the scene has other Gaussians now, or the same in another order; select "
            f"it again with --as {path.stem!r} --force, or remove the file"
        )
    return flags


def carry_named(
    before: Path,
    means: Float[np.ndarray, "n 3"],
    after: Path,
    new_means: Float[np.ndarray, "m 3"],
    origin: Int[np.ndarray, " m"] | None,
) -> None:
    """Write the selections saved beside one scene file for what an edit made of it.

    `origin` is the row that each Gaussian comes from, negative for a new one; None where rows stay.
    Files beside `after` are replaced; those that are not of the scene before are left behind.
    """
    for stale in folder_of(after).glob("*.npy"):
        stale.unlink()
    for name in saved_names(before):
        try:
            flags = read_named(folder_of(before) / f"{name}.npy", means)
        except InputError:
            continue
        kept = flags if origin is None else (origin >= 0) & flags[np.maximum(origin, 0)]
        save_named(kept, new_means, after, name)
