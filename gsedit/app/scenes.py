"""Scenes that a page has read, kept in memory while there is room."""

from __future__ import annotations

from pathlib import Path
from threading import RLock

from gsedit.app.loaded import Loaded, read

KEPT_GAUSSIANS = 1_200_000
"""Gaussians of the scenes in memory, the newest aside: 280 MB at SH degree 3. Going back and forth
between them reads nothing again."""


class Scenes:
    """Scenes by their files, each read once while there is room."""

    def __init__(self) -> None:
        """Begin without any scene."""
        self._scenes: dict[Path, Loaded] = {}
        self._lock = RLock()

    def __len__(self) -> int:
        """Return the number of scenes in memory."""
        return len(self._scenes)

    def load(self, file: Path) -> Loaded:
        """The scene of a file. Raises InputError for a damaged one."""
        with self._lock:
            found = self._scenes.pop(file, None) or read(file)
            self._scenes[file] = found
            most = KEPT_GAUSSIANS + len(found.scene)
            while sum(len(each.scene) for each in self._scenes.values()) > most:
                self._scenes.pop(next(iter(self._scenes)))
            return found

    def forget(self, folder: Path) -> None:
        """Drop the scenes of the files in a folder, which is removed."""
        with self._lock:
            for file in [each for each in self._scenes if each.is_relative_to(folder)]:
                self._scenes.pop(file)
