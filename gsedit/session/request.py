"""What an edit is given."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsedit.editors.protocol import Editor
from gsedit.measures.features import FeatureExtractor
from gsedit.ranks import ALONE, Ranks
from gsedit.session.settings import EditSettings
from gsedit.views.coarse import Coarse
from gsedit.views.dataset import View
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Request:
    """What an edit is given."""

    scene: Gaussians
    prompt: str
    views: tuple[View, ...]
    """Those that may be edited; indices elsewhere are into these."""
    held_out: tuple[View, ...]
    """Those that are only measured at."""
    editor: Editor
    settings: EditSettings
    features: FeatureExtractor
    """Under the Gram loss."""
    generator: torch.Generator
    coarse: Coarse | None = None
    """Of a large scene: its cells, which are the `scene` here, and the scene itself."""
    all_views: bool = False
    """Whether the strategy edits or renders all of `views`, not only those of the plan."""
    ranks: Ranks = ALONE
    """Among which the work is shared out; each has the whole session."""

    @property
    def whole(self) -> Gaussians:
        """The scene that pictures show."""
        return self.scene if self.coarse is None else self.coarse.fine
