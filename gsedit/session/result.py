"""The result of an edit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gsedit.session.quality import EditQuality
from gsedit.session.settings import EditSettings
from gsedit.views.dataset import View
from gsedit.views.plan import ViewPlan
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class EditResult:
    """An edited scene and its evidence: the same cameras three times."""

    scene: Gaussians
    originals: tuple[View, ...]
    """Renders of the unedited scene."""
    targets: tuple[View, ...]
    """The edited 2D pictures that the scene was fitted to."""
    finals: tuple[View, ...]
    """Renders of the edited scene."""
    settings: EditSettings
    """With the editor's defaults filled in."""
    strategy: Any
    """Settings of the strategy; their type says which one."""
    plan: ViewPlan
    """Which views were to be edited, and what they cover."""
    quality: EditQuality
    """What was measured."""
    timings: dict[str, float]
    """Seconds per stage, and in total."""
