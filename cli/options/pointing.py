"""Options that point at a thing of a scene: pixels of its views, or a phrase."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option
from .cameras import ViewOptions, resolve_cameras

if TYPE_CHECKING:
    import torch

    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.mask_protocol import MaskProvider
    from gsedit.regions.region import Region
    from gsedit.selecting.click import Click
    from rasterizer.scene import Gaussians

PLACE = re.compile(r"(?P<out>not:)?(?P<view>.+):(?P<x>\d+(\.\d*)?),(?P<y>\d+(\.\d*)?)")
"""A pixel of a view: [not:]VIEW:X,Y."""
FOUND_VIEWS = 24
"""Views that are found for a scene without cameras."""


@dataclass(frozen=True)
class AtOptions:
    """The option that chooses a thing by pixels."""

    at: list[str] | None = option(
        None,
        "Select the object at a pixel, as in frame_00012.jpg:130,80 or 3:130,80; repeatable: the "
        "same place again is the part of it there, and then a smaller one. not:VIEW:X,Y takes "
        "away what is there. Column and row of the view at --size.",
        "VIEW:X,Y",
    )

    def check(self) -> None:
        """Raise UsageError for a place that is none."""
        for text in self.at or ():
            place(text)

    def clicked(self, scene: Gaussians, views: Sequence[Viewpoint]) -> Region:
        """Return the object at the places. Raises UsageError where nothing is there."""
        from gsedit.objects import select_at

        cameras = [each.camera for each in views]
        return select_at(scene, [click(text, views) for text in self.at or ()], cameras)


@dataclass(frozen=True)
class PointingOptions(AtOptions):
    """Options that choose a thing by a pixel or by words."""

    phrase: str | None = option(
        None,
        "Select by words, as in 'the red one', 'second from the left', 'the ground'.",
        "PHRASE",
    )
    size: int | None = option(
        None, "Longer side of the views that --at counts in.", "PIXELS", min=16, show_default="256"
    )

    @property
    def given(self) -> bool:
        """Whether anything was pointed at."""
        return bool(self.at) or self.phrase is not None

    def check(self) -> None:
        """Raise UsageError for both ways at once, or a place that is none."""
        if self.at and self.phrase is not None:
            raise UsageError("--at and --phrase both name a thing: leave one out")
        super().check()

    def views(self, path: Path, scene: Gaussians, data: Path | None) -> tuple[Viewpoint, ...]:
        """Return the views of --data, those recorded beside the scene, or found ones."""
        return views_to_point_at(path, scene, ViewOptions(data=data, size=self.size))

    def region(
        self,
        scene: Gaussians,
        views: Sequence[Viewpoint],
        subject: Subject | None = None,
        masks: MaskProvider | None = None,
    ) -> Region:
        """Return what is pointed at. Raises UsageError where that is nothing."""
        from gsedit.objects import find_phrase

        if self.at:
            return self.clicked(scene, views)
        cameras = [each.camera for each in views]
        return find_phrase(self.phrase or "", scene, cameras, subject=subject, masks=masks)


if TYPE_CHECKING:
    from collections.abc import Callable

    Subject = Callable[[], torch.Tensor | None]


def views_to_point_at(path: Path, scene: Gaussians, options: ViewOptions) -> tuple[Viewpoint, ...]:
    """Return the views whose pixels --at names, the same for every verb."""
    from rasterizer.numerics import AUTO

    return resolve_cameras(path, scene, options, FOUND_VIEWS, AUTO).viewpoints


def place(text: str) -> tuple[str, float, float, bool]:
    """Return (view, x, y, inside) of a place. Raises UsageError."""
    found = PLACE.fullmatch(text.strip())
    if found is None:
        raise UsageError(
            f"--at {text}: give a view, a column and a row, as in --at frame_00012.jpg:130,80, or "
            "not:... for a place that is not on it"
        )
    return found["view"], float(found["x"]), float(found["y"]), found["out"] is None


def click(text: str, views: Sequence[Viewpoint]) -> Click:
    """Return the click at a place of one of the views. Raises UsageError for no such view."""
    from gsedit.datasets.viewpoints import view_named
    from gsedit.objects import Click

    name, x, y, inside = place(text)
    view = view_named(views, name)
    return Click(view.camera, x + 0.5 * x.is_integer(), y + 0.5 * y.is_integer(), inside, view.name)
