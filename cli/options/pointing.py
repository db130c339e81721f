"""Options that point at a thing of a scene, pixels of its views or a phrase; and its finder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option
from ..core.current import current_scene
from .cameras import ViewOptions, resolve_cameras
from .settings import Values

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.select.finder import Finder
    from gsedit.select.masked import MaskProvider
    from gsedit.select.region import Region
    from rasterizer.scene import Gaussians

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

    def expression(self) -> str:
        """Return the expression of the places. Raises UsageError for one that is none."""
        from gsedit.select.where import expression_of_clicks

        return expression_of_clicks(self.at or ())

    def in_place_of_region(self, values: Values) -> Values:
        """Return the settings of an edit with what is pointed at as their region.

        Raises UsageError for --region beside it, or a place that is none.
        """
        if not self.at:
            return values
        if ("region",) in values:
            raise UsageError("--at and --region both say where: leave one out")
        return {**values, ("region",): self.expression()}


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
        if self.at:
            self.expression()

    def region(self, finder: Finder) -> Region:
        """Return what is pointed at. Raises UsageError where that is nothing."""
        return finder.select(self.expression()) if self.at else finder.named(self.phrase or "")


def finder_in(
    data: Path | None, size: int | None = None, masks: MaskProvider | None = None
) -> Callable[[Gaussians], Finder]:
    """Return the maker of a finder of the scene that the command reads, with its views and names.

    Views are those of `data`, of the cameras.json beside the scene, or found ones.
    """

    def finder(scene: Gaussians) -> Finder:
        from gsedit.select.finder import Finder, Names
        from gsedit.select.saved import saved_files

        path = current_scene.get()
        saved = {} if path is None else saved_files(path)
        views = views_to_point_at(path, scene, ViewOptions(data=data, size=size))
        return Finder(scene, views, names=Names(saved, masks))

    return finder


def views_to_point_at(
    path: Path | None, scene: Gaussians, options: ViewOptions
) -> Sequence[Viewpoint]:
    """Return the views whose pixels --at names, the same for every verb."""
    from rasterizer.numerics import AUTO

    return resolve_cameras(path, scene, options, FOUND_VIEWS, AUTO).viewpoints
