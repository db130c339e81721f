"""Changes of a scene in a test: one by its painter, or all of a sentence in known parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.editing.edit import change_steps
from gsedit.editing.measure import Changed
from gsedit.editing.painters import PAINTERS, Looking
from gsedit.editing.plan import key_of, steps_of
from gsedit.run.events import returned
from gsedit.scene.outcome import Outcome
from gsedit.select.finder import Finder
from gsedit.select.region import Region
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.instruction import Change
from gsedit.words.read import read_instruction
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians


def painted(
    scene: Gaussians, change: Change, inside: Bool[Tensor, " n"], cameras: Sequence[Camera] = ()
) -> Outcome:
    """One change of the Gaussians inside."""
    flags = {key_of(change): inside}
    return PAINTERS[change.route](scene, (change,), flags, Looking(cameras))


class Known(Finder):
    """Finds what a test says: the subject, and what phrases name."""

    def __init__(
        self,
        scene: Gaussians,
        subject: Bool[Tensor, " n"] | None = None,
        cameras: Sequence[Camera] = (),
        phrases: Mapping[str, Bool[Tensor, " n"]] | None = None,
    ) -> None:
        """Without a subject, everything is."""
        super().__init__(scene, [Viewpoint(str(i), each) for i, each in enumerate(cameras)])
        self.main = torch.ones(len(scene), dtype=torch.bool) if subject is None else subject
        self.phrases = phrases or {}

    @property
    def subject(self) -> Region:
        return Region(self.main, "subject")

    @property
    def cameras(self) -> list[Camera]:
        return [each.camera for each in self._given]

    def named(self, phrase: str) -> Region:
        return Region(self.phrases[phrase], phrase)


def changed_by(sentence: str, finder: Finder, shown: Bool[Tensor, " n"] | None = None) -> Changed:
    """The finder's scene after all changes of a sentence."""
    return returned(change_steps(finder, steps_of(read_instruction(sentence)), shown=shown))
