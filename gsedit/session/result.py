"""The result of an edit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
    matched: float | None
    """Mean fraction of latent cells matched between two views of a batch; None without any two."""
    pairs: tuple[tuple[str, str, float], ...]
    """(view, view, matched fraction) of every two views that were in a batch together."""
    strength: float
    """RMSE between original and final renders: 0 is no edit at all."""
    residual: float
    """PSNR of the final renders against the 2D targets, dB."""
    ground_truth: float | None
    """PSNR to the true edit at cameras that were never edited, dB; None where it is unknown."""
    timings: dict[str, float]
    """Seconds per stage, and in total."""
