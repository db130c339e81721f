"""A sentence on the scene that a tab shows, before it is applied."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from threading import Thread, get_native_id

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from gsedit.app.frames import SMALL_SCENE
from gsedit.app.loaded import DRAFT_PIXELS, Loaded, give_back
from gsedit.app.reading import Reading, editor_2d, read
from gsedit.change.objects.growth.places import FALLS
from gsedit.editing.edit import change_steps
from gsedit.editing.measure import Changed
from gsedit.editing.parts import SUBJECT, aimed_at, find_parts
from gsedit.editing.plan import is_exact, key_of
from gsedit.editing.preview import drawn_region, preview_coarse, preview_edited, shown_by
from gsedit.errors import GseditError, UsageError
from gsedit.formats.pictures import eight_bits
from gsedit.run.events import returned
from gsedit.select.finder import Finder, Names
from gsedit.select.saved import saved_files
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

SLOW_ROUTES = ("paint", "material")
"""Routes that are quicker where only the Gaussians of one view get their reflections."""
PREPARED = ("make it night", "paint it glossy red", "paint it red", "remove it", "make it snow",
            "a thick layer of snow on it", "make it half the size")  # fmt: skip
"""Sentences whose previews are made before anyone asks: they need all that is kept of a scene."""


class Previewer:
    """Previews of one scene and one selection. What a sentence names is found once."""

    def __init__(self, loaded: Loaded, region: Path | None) -> None:
        """`region`: file of the selected Gaussians; None: the sentence says what changes."""
        self.loaded = loaded
        self.region = SUBJECT if region is None else str(region)

    def is_exact(self, reading: Reading) -> bool:
        """Whether the preview is a scene; else it is a picture of one view."""
        return reading.first is not None and is_exact(reading.first)

    def is_partial(self, reading: Reading) -> bool:
        """Whether a preview for one view is quicker than that of the whole scene."""
        changes = reading.first.changes if reading.first is not None else ()
        snows = [each.route == "scenery" and each.name in FALLS for each in changes]
        return any(snows) or any(each.route in SLOW_ROUTES for each in changes)

    @torch.no_grad()
    def scene(self, reading: Reading, camera: Camera | None = None) -> Changed:
        """The scene with the first edit of a sentence; with a camera what it sees is right, the
        rest may keep its reflections. Raises UsageError as `change_steps` does."""
        assert reading.first is not None  # what is refused has no preview
        scene, shown = self.loaded.scene, None
        if camera is not None:
            shown = shown_by(scene, camera)
        with self.loaded.cache.used():
            return returned(change_steps(self.finder, (reading.first,), shown=shown))

    def target(self, reading: Reading) -> Tensor | None:
        """Flags (n,) of what the first edit of a sentence changes; None for the whole scene, and
        where only drawn pictures will tell. Raises UsageError as `find_parts`."""
        assert reading.first is not None
        steps = aimed_at((reading.first,), self.finder.region)
        found = find_parts(steps, self.finder, editor_2d()).flags
        flags = [found[key] for each in steps[0].changes if (key := key_of(each)) in found]
        if not flags:
            return None
        union = torch.stack(flags).any(0)
        return None if union.all() else union

    @torch.no_grad()
    def glimpse(self, reading: Reading, camera: Camera) -> Gaussians | None:
        """The scene about as an exact sentence makes it, at once: made of its groups, looked at
        from few sides and from here; None where nothing is quicker than the preview itself."""
        draft = self.loaded.draft
        if draft is None or reading.first is None or not self.is_exact(reading):
            return None
        camera = camera.fitted(2 * DRAFT_PIXELS)
        with suppress(UsageError), draft.cache.used():  # too small for groups: the preview tells
            return preview_coarse(draft.merged, reading.first, self.finder, draft.cameras, camera)
        return None

    def picture(self, reading: Reading, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
        """One view as the 2D editor draws it. Raises UsageError as `preview_edited` does."""
        assert reading.first is not None  # what is refused has no preview
        region = drawn_region(self.finder, reading.first, editor_2d())
        scene, step = self.loaded.scene, reading.first
        found = preview_edited(scene, step, camera, editor_2d(), region=region)
        return eight_bits(found.after.image)

    def prepare(
        self, wanted: Callable[[], bool] = lambda: True, sentences: Sequence[str] = PREPARED
    ) -> None:
        """Warm the caches with what glimpses of the sentences need and, of small scenes, what
        they need themselves. Stop when it is not `wanted`."""
        camera, small = self.loaded.first_camera(), len(self.loaded.scene) <= SMALL_SCENE
        for make in (self.glimpse, self.scene)[: 1 + small]:
            for sentence in sentences:
                with suppress(GseditError):
                    if wanted():
                        make(read(sentence), camera)
        give_back()

    def prepare_behind(
        self, wanted: Callable[[], bool], first: Callable[[], None] = lambda: None
    ) -> None:
        """Find the objects and the subject in a thread; then do what is to be done `first`, and
        prepare, behind all other work."""

        def work() -> None:
            with suppress(GseditError):  # the preview that needs it will tell
                _ = self.finder.subject
            if hasattr(os, "setpriority"):
                with suppress(OSError):
                    # niceness, where threads have one: moving pictures come first
                    os.setpriority(os.PRIO_PROCESS, get_native_id(), 10)
            if wanted():
                first()
            self.prepare(wanted)

        Thread(target=work, daemon=True, name="prepare").start()

    def rename(self) -> None:
        """Hear the names that are saved beside the scene now."""
        if "finder" in self.__dict__:
            self.finder.rename(self._names())

    @cached_property
    def finder(self) -> Finder:
        """Finds what sentences name, in all views, as the edit does it."""
        return self.loaded.ready().in_region(self.region, self._names())

    def _names(self) -> Names:
        return Names(saved_files(self.loaded.file))
