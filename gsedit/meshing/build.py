"""A mesh of a scene: what views see, fused, tidied and colored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.cameras.around import FOUND_SIZE_PIXELS, find_viewpoints
from gsedit.cameras.paths import common_point
from gsedit.datasets.dataset import evenly_spaced
from gsedit.errors import UsageError
from gsedit.meshing.backdrop import backdrop_color, before_backdrop
from gsedit.meshing.close import closed
from gsedit.meshing.fuse import Ball, fuse
from gsedit.meshing.paint import painted
from gsedit.meshing.tidy import decimated, smoothed, without_crumbs
from gsedit.meshing.triangles import Mesh
from gsedit.surface.depth import SeenSurface, seen_surface
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

FACES = 200_000
"""Faces of a mesh: what a browser or a game shows at ease."""
VIEWS, FOUND = 64, 36
"""Most views that are fused, and those that are found; more cost time, and agree."""
RINGS = (20.0, 55.0, -25.0)
"""Elevations, degrees, of the views around an object without cameras: it has an underside."""
SURVEY_PIXELS = 192
"""Longer side of the pictures that tell how large and how fine the surface is."""
MOST_PIXELS = 800
"""Longest side of the pictures that are fused."""
FINENESS = 0.45
"""Side of the voxels, in the median standard deviation of the Gaussians that are seen: finer ones
show their noise."""
FEW, COARSE = 0.02, 2.0
"""Share of what is seen below which all seems haze: a scene of few, wide Gaussians. Up to so many
times their median standard deviation they are taken then."""
REACHED, MARGIN = 0.98, 1.1
"""Share of what is seen that a mesh holds, and the radius of its ball against its reach."""


@torch.no_grad()
def mesh(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    *,
    inside: Bool[Tensor, " n"] | None = None,
    faces: int = FACES,
    watertight: bool = False,
    execution: Execution = AUTO,
) -> Mesh:
    """Make a mesh of at most `faces` triangles of what the cameras look at; found ones without any.

    Of a capture it ends at the cameras' distance from what they look at. `inside` are the Gaussians
    to take, drawn alone. `watertight` closes the surface where nobody saw it, too. Units and axes
    are those of the scene. Raises UsageError where there is no surface.
    """
    if faces < 4:
        raise UsageError(f"a mesh has 4 faces or more, not {faces}")
    if any(camera.model != "pinhole" for camera in cameras):
        raise UsageError("a mesh is made from pinhole cameras: leave the parallel ones out")
    alone = scene if inside is None else scene[inside]
    if not len(alone):
        raise UsageError("nothing is selected: there is no surface to make a mesh of")
    chosen = _views(alone, cameras, execution)
    survey = _survey(alone, chosen, inside is not None, execution)
    ball, voxel = survey.ball, survey.voxel
    views = [_scaled(camera, survey.pixel / voxel) for camera in chosen]
    surfaces = [survey.of(seen_surface(alone, camera, execution)) for camera in views]
    found, voxel = fuse(surfaces, ball, voxel)
    found = without_crumbs(found)
    if not len(found.faces):
        raise UsageError("no surface was found: its Gaussians are too faint, or no view sees it")
    found = smoothed(found)
    found = without_crumbs(closed(found, voxel, faces)) if watertight else decimated(found, faces)
    return replace(found, colors=painted(found, surfaces, voxel))


def _views(scene: Gaussians, cameras: Sequence[Camera], execution: Execution) -> Sequence[Camera]:
    """The views that are fused: some of the cameras, or found ones."""
    if cameras:
        return [cameras[i] for i in evenly_spaced(len(cameras), VIEWS)]
    found = find_viewpoints(scene, FOUND, FOUND_SIZE_PIXELS, rings=RINGS, execution=execution)
    return [each.camera for each in found]


@dataclass(frozen=True, eq=False)
class _Survey:
    """Facts that small pictures tell."""

    ball: Ball
    """Part of the world to make a mesh of."""
    voxel: float
    """Side of the voxels, world units."""
    pixel: float
    """The side of a pixel of the cameras, on the surface."""
    backdrop: Float[Tensor, "3"] | None
    """Its color, where it has one."""

    def of(self, surface: SeenSurface) -> SeenSurface:
        """The surface without the backdrop; its pictures in half precision, for there are many."""
        if self.backdrop is not None:
            surface = before_backdrop(surface, self.backdrop, self.ball)
        return replace(surface, color=surface.color.half(), alpha=surface.alpha.half())


def _survey(
    scene: Gaussians, cameras: Sequence[Camera], whole: bool, execution: Execution
) -> _Survey:
    """Survey what is seen: all of it if `whole`, else what the cameras look at."""
    seen = [seen_surface(scene, camera.fitted(SURVEY_PIXELS), execution) for camera in cameras]
    ball = _ball(seen, cameras, whole)
    backdrop = backdrop_color(seen, ball)
    if backdrop is not None:
        rest = [before_backdrop(surface, backdrop, ball) for surface in seen]
        if any(bool(surface.seen.any()) for surface in rest):
            seen, ball = rest, _ball(rest, cameras, whole, usual=torch.inf)
        else:  # all has its color: it tells nothing apart
            backdrop = None
    points, spread, sides = _pixels(seen, cameras)
    held = ball.holds(points, spread)
    if not held.any():
        raise UsageError("the views show haze and no surface: add --region")
    pixel = float(sides[held].median())
    longest = max(max(camera.width, camera.height) for camera in cameras)
    voxel = max(FINENESS * float(spread[held].median()), pixel * longest / MOST_PIXELS)
    return _Survey(ball, voxel, pixel, backdrop)


def _pixels(
    seen: Sequence[SeenSurface], cameras: Sequence[Camera]
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, " p"], Float[Tensor, " p"]]:
    """(places, standard deviations of Gaussians, sides of the cameras' pixels) of what is seen."""
    shown = [surface.seen for surface in seen]
    points = torch.cat([surface.points[h] for surface, h in zip(seen, shown)])
    spread = torch.cat([surface.spread[h] for surface, h in zip(seen, shown)])
    sides = [s.depth[h] / c.fx for s, h, c in zip(seen, shown, cameras)]
    if not len(points):
        raise UsageError("the views show no surface: name cameras by --data, or add --region")
    return points, spread, torch.cat(sides)


def _ball(
    seen: Sequence[SeenSurface], cameras: Sequence[Camera], whole: bool, usual: float = 0.0
) -> Ball:
    """The ball that holds nearly all of the surface, or what of it the cameras look at."""
    points, spread, _ = _pixels(seen, cameras)
    target = None if whole else common_point(cameras)
    center = points.median(0).values if target is None else target
    most = torch.inf
    if target is not None:
        eyes = torch.stack([camera.center.detach().double() for camera in cameras])
        most = float((eyes - center).norm(dim=-1).median())
    away = (points - center).norm(dim=-1)
    radius = min(most, float(away.max()) * MARGIN)
    near, first = away < radius, Ball(center, radius, usual)
    if float(first.holds(points, spread).sum()) < FEW * float(near.sum()):
        usual = COARSE * float(spread[near].median())
        first = Ball(center, radius, usual)
    held = away[first.holds(points, spread)].sort().values
    if not len(held):
        return first
    return Ball(center, min(most, MARGIN * float(held[int(REACHED * (len(held) - 1))])), usual)


def _scaled(camera: Camera, factor: float) -> Camera:
    """The view on so many times the pixels, at most MOST_PIXELS on its longer side."""
    longest = max(camera.width, camera.height)
    factor = min(factor, MOST_PIXELS / longest)
    return camera.resized(*(max(1, round(factor * s)) for s in (camera.width, camera.height)))
