"""Bending as an operation on a scene's file: handles given by pixels of views or by points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.scene.table import SplatTable, gaussians_of, table_of
from gsedit.select.rules import EVERYTHING, Selection
from gsedit.toolkit.operation import Say, Whole

if TYPE_CHECKING:
    from gsedit.change.objects.bending.bend import Handle
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.scene import Gaussians

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Pixel:
    """A pixel of a view: the point of the surface under it is meant."""

    view: str
    """Its name, or its number in the file of cameras, from 0."""
    x: float
    y: float


@dataclass(frozen=True)
class Grip:
    """A place, where it is moved, and how far around it all moves alike."""

    at: Pixel | Triple
    move: Triple = (0.0, 0.0, 0.0)
    """World units; 0, 0, 0 holds the place."""
    radius: float = 0.0


@dataclass(frozen=True)
class Bend(Whole):
    """Bend the selected Gaussians so that the grips are where they are moved to."""

    grips: tuple[Grip, ...]
    selection: Selection = EVERYTHING
    cage: Selection | None = None
    """Gaussians that may move; None: all that are selected."""
    cameras: Path | None = None
    """File of the cameras whose pixels grips name."""

    def apply(self, table: SplatTable, say: Say) -> SplatTable:
        import torch

        from gsedit.change.objects.bending.bend import bend

        scene = gaussians_of(table)
        inside = torch.from_numpy(self.selection.mask(table))
        cage = None if self.cage is None else torch.from_numpy(self.cage.mask(table))
        outcome = bend(scene, inside, self._handles(scene), cage)
        for note in outcome.notes:
            say(note)
        after = table_of(outcome.scene)
        fields = ("means", "quats", "log_scales", "sh")
        return table.replace(**{name: getattr(after, name) for name in fields})

    def _handles(self, scene: Gaussians) -> list[Handle]:
        from gsedit.change.objects.bending.bend import Handle
        from gsedit.views.depth import point_at
        from gsedit.views.viewpoints import view_named

        views = _views(self.cameras)
        handles = []
        for grip in self.grips:
            if isinstance(grip.at, Pixel):
                camera = view_named(views, grip.at.view).camera
                x, y, z = point_at(scene, camera, grip.at.x, grip.at.y).tolist()
            else:
                x, y, z = grip.at
            dx, dy, dz = grip.move
            handles.append(Handle((x, y, z), (x + dx, y + dy, z + dz), grip.radius))
        return handles


def _views(cameras: Path | None) -> Sequence[Viewpoint]:
    from gsedit.views.cameras_json import read_cameras

    return () if cameras is None else read_cameras(cameras)
