"""The parts of a scene that instructions name, each found once: for one edit, or many previews."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import torch

from gsedit import objects
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.editing.routes.named import Names
from gsedit.editing.routes.subject import find_part
from gsedit.regions.region import Region
from gsedit.regions.saved import read_named
from gsedit.selecting.carrier import carrier
from gsedit.selecting.segment import Segments
from gsedit.words.phrases import CARRIERS
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


class Finder:
    """Finds the subject of a scene and what phrases name in it, each once."""

    def __init__(
        self,
        scene: Gaussians,
        viewpoints: Sequence[Viewpoint],
        region: str = "auto",
        names: Names | None = None,
        execution: Execution = AUTO,
        segment: Callable[[], Segments] | None = None,
    ) -> None:
        """Keep the scene, the views in which it is looked at, and the region that stands for the
        subject (see gsedit.regions.parse); nothing is computed yet. `segment` returns the objects
        of the scene where something else has found them."""
        self.scene, self.viewpoints, self.region = scene, tuple(viewpoints), region
        self.cameras = [each.camera for each in viewpoints]
        self.names, self.execution = names or Names(), execution
        self._segment = segment
        self._named: dict[str, Region] = {}

    @cached_property
    def subject(self) -> Region:
        """The subject, or what the region holds. Raises as `find_part` does."""
        return find_part(self.scene, self.viewpoints, self.region, self.execution)

    @cached_property
    def segments(self) -> Segments:
        """The objects of the scene."""
        if self._segment is not None:
            return self._segment()
        return objects.segment(self.scene, self.cameras, self.execution)

    def rename(self, names: Names) -> None:
        """Take other saved selections and masks; the subject and the objects stay found."""
        self.names, self._named = names, {}  # a search that runs keeps its result in the old ones

    def named(self, phrase: str) -> Region:
        """Gaussians that a phrase names: a saved selection, the support of things, or an object.

        Raises UsageError and InputError as `find_phrase` and `read_named`.
        """
        known = self._named
        if phrase not in known:
            known[phrase] = self._find(phrase)
        return known[phrase]

    def _find(self, phrase: str) -> Region:
        names = self.names
        if file := names.file_of(phrase):
            flags = read_named(file, self.scene.means.detach().numpy())
            return Region(torch.from_numpy(flags), f"{phrase}, as it was saved")
        known = None if names.masks is not None else self.segments
        if known is not None and phrase in CARRIERS and (found := carrier(known)):
            return found
        return objects.find_phrase(
            phrase, self.scene, self.cameras, known, lambda: self.subject.inside, names.masks,
            self.execution,
        )  # fmt: skip
