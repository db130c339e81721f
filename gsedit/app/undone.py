"""Steps that were undone, or never ended: what they take on the disk, and removing them."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from gsedit.app.document import STEPS, Document


@dataclass(frozen=True)
class Undone:
    """Folders of a session that no step up to the one that is shown needs."""

    folders: tuple[Path, ...] = ()
    size: int = 0
    """Bytes of their files."""


def undone(document: Document, session: Path | None) -> Undone:
    """Find what may go of a session's folder, without what can go on after an interruption."""
    if session is None or not (session / STEPS).is_dir():
        return Undone()
    done = document.steps[: document.position + 1]
    waiting = () if document.pending is None else document.pending.command
    named = [part for each in done for part in (each.scene, *each.command)]
    kept = [(session / each).resolve() for each in (*named, *waiting)]
    folders = [
        each
        for each in sorted((session / STEPS).resolve().iterdir())
        if each.is_dir() and not each.is_symlink() and not any(k.is_relative_to(each) for k in kept)
    ]
    files = [file for each in folders for file in each.rglob("*") if file.is_file()]
    return Undone(tuple(folders), sum(file.lstat().st_size for file in files))


def without(document: Document) -> Document:
    """The document without the steps that are undone."""
    return replace(document, steps=document.steps[: document.position + 1])


def remove(found: Undone) -> None:
    """Remove the folders. Raises OSError where the disk does not let go of one."""
    for each in found.folders:
        shutil.rmtree(each)
