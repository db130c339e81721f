"""Scenes as a page reads them: the Gaussians, how they are rendered, and where one looks from."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import Lock, RLock
from typing import TYPE_CHECKING

import torch

from gsedit.app.looking import best_of
from gsedit.errors import GseditError
from gsedit.formats.scenes import read_scene
from gsedit.scene.cache import SceneCache
from gsedit.scene.framing import Bounds, bounds, framing_camera, guess_up
from gsedit.scene.merging import MergedScene, coarsen
from gsedit.views.around import FOUND_VIEWS, find_viewpoints
from gsedit.views.cameras_json import cameras_file, recorded_viewpoints
from gsedit.views.dataset import evenly_spaced
from gsedit.views.paths import common_point, up_of
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.select.finder import Finder

ARENAS_OPTION, ARENAS = -8, 2
"""M_ARENA_MAX of mallopt(3), and how many heaps threads share."""


def share_heaps() -> None:
    """Let threads share heaps; to be called before they start. Nothing where the C library has no
    such option."""
    with suppress(OSError, AttributeError):
        if sys.platform == "linux":
            ctypes.CDLL(None).mallopt(ARENAS_OPTION, ARENAS)


def give_back() -> None:
    """Return what is free, as far as the C library can."""
    with suppress(OSError, AttributeError):
        if sys.platform == "linux":
            ctypes.CDLL(None).malloc_trim(0)


KEPT_GAUSSIANS = 1_200_000
"""Gaussians of the scenes in memory, the newest aside: 280 MB at SH degree 3. Going back and forth
between them reads nothing again."""


class Scenes:
    """Scenes by their files, each read once while there is room."""

    def __init__(self, most: int = KEPT_GAUSSIANS) -> None:
        """Begin without any scene; keep `most` Gaussians beside the newest."""
        self._most = most
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
            most = self._most + len(found.scene)
            while sum(len(each.scene) for each in self._scenes.values()) > most:
                self._scenes.pop(next(iter(self._scenes)))
            return found

    def forget(self, folder: Path) -> None:
        """Drop the scenes of the files in a folder, which is removed."""
        with self._lock:
            for file in [each for each in self._scenes if each.is_relative_to(folder)]:
                self._scenes.pop(file)


VIEW_PIXELS = 256
"""Longer side of the views in which edits and selections look at the scene, as the command line
has it."""


DRAFT_GAUSSIANS, DRAFT_VIEWS, DRAFT_PIXELS = 20_000, 16, 128
"""Groups of a scene that is changed within half a second, about as the whole; and the views in
which it is looked at, with their longer side."""


@dataclass(frozen=True, eq=False)
class Draft:
    """A scene in few groups, as coarse previews change it."""

    merged: MergedScene
    cameras: tuple[Camera, ...]
    cache: SceneCache


@dataclass(frozen=True, eq=False)
class Loaded:
    """A scene that was read from a file."""

    file: Path
    scene: Gaussians
    numerics: Numerics
    notes: tuple[str, ...]
    draft_gaussians: int = DRAFT_GAUSSIANS
    whole: bool = True  # no checkpoint

    @cached_property
    def bulk(self) -> Bounds:
        """The ball of the scene's bulk."""
        return bounds(self.scene)

    @cached_property
    def viewpoints(self) -> tuple[Viewpoint, ...]:
        """Views recorded beside the file, or found ones: where edits and selections look from."""
        return self.recorded or find_viewpoints(self.scene, FOUND_VIEWS, VIEW_PIXELS)

    @cached_property
    def recorded(self) -> tuple[Viewpoint, ...]:
        """The views recorded beside the file; none where none of them sees the scene."""
        return recorded_viewpoints(self.scene, cameras_file(self.file), VIEW_PIXELS)

    @cached_property
    def finder(self) -> Finder:
        """Finds what is clicked and said; objects and subject are found once."""
        from gsedit.select.finder import Finder  # half a second: not before the first picture

        return Finder(self.scene, self.viewpoints)

    @cached_property
    def looking(self) -> Lock:
        """Held by the one thread that looks for the objects."""
        return Lock()

    def ready(self) -> Finder:
        """The finder, with the objects found: by one thread, for which the others wait."""
        with self.looking, suppress(GseditError):  # whoever needs them will tell
            if "objects" not in vars(self):
                _ = self.finder.selector.segments, self.finder.segments
                vars(self)["objects"] = True
        return self.finder

    @property
    def is_ready(self) -> bool:
        """Whether the objects are found, so that a click is quick."""
        return "objects" in vars(self)

    @cached_property
    def cache(self) -> SceneCache:
        """Results about the scene that previews need alike."""
        return SceneCache(self.scene)

    @cached_property
    def draft(self) -> Draft | None:
        """The scene in few groups; None where it has no more Gaussians than that."""
        merged, views = coarsen(self.scene, self.draft_gaussians), self.viewpoints
        if merged is None:
            return None
        few = (views[i].camera for i in evenly_spaced(len(views), DRAFT_VIEWS))
        cameras = tuple(each.fitted(DRAFT_PIXELS) for each in few)
        return Draft(merged, cameras, SceneCache(merged.scene))

    def forget(self) -> None:
        """Drop these results: they take more memory than the scene, and another one is shown."""
        for name in ("cache", "draft"):
            self.__dict__.pop(name, None)

    def cameras(self) -> list[Camera]:
        """Cameras of the views; of a checkpoint those that are recorded: it is not searched."""
        return [each.camera for each in (self.viewpoints if self.whole else self.recorded)]

    @cached_property
    def middle(self) -> torch.Tensor:
        """The place that the cameras look at, or the middle of the bulk; float64."""
        cameras = self.cameras()
        found = common_point(cameras) if cameras else None
        return torch.tensor(self.bulk.center, dtype=torch.float64) if found is None else found

    def first_camera(self) -> Camera:
        """The camera of the first picture: the one that shows the middle best."""
        cameras = self.cameras()
        return best_of(cameras, self.middle, self.up()) if cameras else framing_camera(self.scene)

    def up(self) -> torch.Tensor:
        """The upward direction of the cameras, or of the ground."""
        cameras = self.cameras()
        return up_of(cameras) if cameras else guess_up(self.scene)


def read_checkpoint(file: Path, unedited: Gaussians | None) -> Loaded:
    """The scene of a fit or an edit that goes on, by its last checkpoint; an edit's moves some of
    the Gaussians of the `unedited` scene. Raises InputError for a damaged file."""
    from gsedit.capture.fitting.optimizer import optimized_scene
    from gsedit.run.state import load_state, restoring

    state = load_state(file)
    with restoring(state):
        start = unedited if "scene" in state.record.get("source", {}) else None
        scene = optimized_scene(state.within("optimizer"), start)
    return Loaded(file, scene.detach(), DEFAULT, (), whole=False)


def read(file: Path) -> Loaded:
    """Read a scene file. Raises InputError and UsageError as `read_scene` does."""
    found = read_scene(file)
    return Loaded(file, found.scene.detach(), found.numerics, tuple(found.notes))
