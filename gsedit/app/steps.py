"""Commands that make a step: where they write, how they go on, and what follows their scene."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from torch import Tensor

from gsedit.app.document import Pending, step_folder
from gsedit.app.loaded import Loaded
from gsedit.errors import UsageError
from gsedit.select.region import Region, save_region
from gsedit.select.saved import carry_named, folder_of, saved_names
from gsedit.views.cameras_json import NAME as CAMERAS
from gsedit.views.cameras_json import cameras_file

FOLDER_VERBS = ("edit", "make")
"""Verbs whose -o is a folder with a scene.ply in it; that of the others is the scene."""
MOVING_VERBS = ("transform", "align")
"""Verbs that move the cameras along where they are asked to."""
RESUMED = ("edit", "clean", "filter", "transform")
RISKY = ("--set", "--save", "--editor", "--masks")
"""Beginnings of options that run programs, write files, or stand for such options."""
REGIONS = "regions"
"""Folder of a session for the selections that commands were given, each named by its flags."""
CHECKPOINT = "checkpoint.safetensors"
"""Name of an edit's checkpoint in its folder."""


def step_of(verb: str, scene: Path, arguments: Sequence[str], title: str, session: Path) -> Pending:
    """The command that makes a scene the next step of a session by a verb."""
    folder = step_folder(session, title)
    out = folder if verb in FOLDER_VERBS else folder / "scene.ply"
    whole = verb in MOVING_VERBS and "--region" not in arguments
    more = ("--cameras",) if whole and cameras_file(scene) else ()
    return Pending(title, (verb, str(scene), *arguments, *more, "-o", str(out)))


def resumed(pending: Pending, session: Path) -> Pending:
    """The command that goes on where it was interrupted: an edit from its checkpoint, any other
    from its start.

    Raises UsageError for a command that the page does not begin itself: the session's file may be
    another's, and gsedit has options that run programs and write anywhere.
    """
    verb, _, *rest = (*pending.command, "", "")
    options = {each for each in rest if each.startswith("--")}
    inside = folder_of_step(pending).resolve().is_relative_to(session.resolve())
    known = verb in RESUMED and not any(each.startswith(RISKY) for each in options)
    more = options - {"--region", "--resume", "--accept-unread"}
    if not inside or not known or (verb == "edit" and more):
        raise UsageError(f"“{pending.title}” is no work that the page begins: do it once more")
    more = "--resume" if pending.command[0] == "edit" else "-f"
    return replace(pending, command=(*(e for e in pending.command if e != more), more))


def region_file(flags: Tensor, session: Path) -> Path:
    """Flags of Gaussians as a .npy file of a session, for --region. A file is never written anew: a
    command that waits, or goes on after a restart, reads what it was given."""
    name = hashlib.sha256(np.packbits(flags.numpy()).tobytes()).hexdigest()[:16]
    path = session / REGIONS / f"{len(flags)}-{name}.npy"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        save_region(Region(flags, "selected"), path, overwrite=True)
    return path


def folder_of_step(pending: Pending) -> Path:
    """The folder that a command writes its scene.ply to."""
    after = pending.command[pending.command.index("-o") + 1 :] if "-o" in pending.command else ()
    out = Path(*after[:1] or ("/",))
    return out if pending.command[0] in FOLDER_VERBS else out.parent


def bring_along(before: Loaded, after: Loaded) -> None:
    """Put beside a scene file what lay beside the one before and still holds: the cameras, and the
    saved selections where the rows are the same; an edit has put its own there."""
    cameras = cameras_file(before.file)
    if cameras is not None and cameras_file(after.file) is None:
        shutil.copyfile(cameras, after.file.with_name(CAMERAS))
    carried = folder_of(after.file).is_dir() or len(before.scene) != len(after.scene)
    if saved_names(before.file) and not carried:
        means, new_means = (each.scene.means.numpy() for each in (before, after))
        carry_named(before.file, means, after.file, new_means, None)
