"""The object under a pixel of a view: clicks, boxes and masks, refined by more clicks.

`n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from gsedit.errors import Said, UsageError
from gsedit.scene.framing import weighted_quantile
from gsedit.scene.neighbors import extent_of
from gsedit.select.layers import level_patches
from gsedit.select.parts import parts
from gsedit.select.region import Region, cut_out
from gsedit.select.segment import Segments, pieces, segment_surfaces
from gsedit.select.surfaces import GROUPS, VIEW_PIXELS, VIEWS, Surfaces, look, looking_at, smooth
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.scene import Gaussians

LEAST_AFFINITY = 0.05
"""Affinity of neighbors that are not alike at all: specks follow what is around them."""
HALF_WINDOW = 1
"""Pixels on either side of the clicked one that have a part in it: one pixel may be a speck."""
SEED, PRIOR = 10.0, 0.02
"""Confidence of a clicked Gaussian, and of one as far as a click reaches, which follows the
selection before it; less nearer to the click. A neighbor of the same kind has STRENGTH."""
STRENGTH = 10.0
"""Weight of a neighbor's value in the random walker."""
SEEDS = 0.1
"""Least part of a Gaussian in a click, of the one with the largest, that is a seed."""
AROUND = 1.5
"""Distance from a further click that it changes, of the click's distance from the border of the
selection: a person clicks in the middle of what is wrong."""
WHOLE = 5.0
"""Largest extent of an object or piece that such a click takes as a whole, of that distance."""
SAME_PLACE = 0.01
"""Largest distance of clicks at one place, of the view's width: a hand moves a pixel or two."""
PART = 0.1
"""Least share of a box or a mask that an object fills."""


@dataclass(frozen=True, eq=False)
class Click:
    """A pixel of a view that is on the object, or that is not."""

    camera: Camera
    x: float
    """Column, pixels from the left border: the first pixel's middle is 0.5."""
    y: float
    inside: bool = True
    name: str = ""
    """Name of the view, for a person."""


class Selector:
    """A scene whose segments are found once, for one click after the other.

    The first click takes the whole object that stands on its support, the same place again a part
    of it, and then a smaller one; a click outside takes away the part of one color that it hits, a
    further one inside adds what it hits.
    """

    def __init__(
        self, scene: Gaussians, cameras: Sequence[Camera] = (), groups: tuple[int, int] = GROUPS
    ) -> None:
        """Keep a scene, cameras that look at it, and the most groups; nothing is computed yet."""
        self.scene = scene.detach()
        self.cameras, self._groups = tuple(cameras), groups
        self._local: dict[tuple[int, ...], Selector] = {}

    @cached_property
    def segments(self) -> Segments:
        """The segments of the scene, as `segment` finds them."""
        found = self._found
        return replace(found, labels=self._surfaces.expanded(found.labels))

    @torch.no_grad()
    def at(self, clicks: Sequence[Click]) -> Region:
        """Select the object under the clicks that are inside, without what is under the others.

        Raises UsageError without a click inside, for one beside its picture, on nothing or on the
        background, and where nothing or everything would be selected.
        """
        if not any(click.inside for click in clicks):
            raise UsageError("no click is inside: click on the object first, then beside it")
        first = next(click for click in clicks if click.inside)
        return self._around(first)._at(clicks, first)

    def _at(self, clicks: Sequence[Click], first: Click) -> Region:
        seeds = self._seeds_of(first)
        row = self._found.rows[self._label(seeds)]
        again = [click for click in clicks if at_one_place(click, first)]
        found = parts(self._surfaces, self._labels == row.number, seeds)
        *larger, inside = islice(found, len(again))
        for click in (each for each in clicks if each not in again):
            inside = self._without_support(inside, click, first)
            inside = self._refined(inside, click)
        name = f"part {len(larger)} of " * bool(larger) + f"{row.kind} {row.number}"
        least = len(larger) + 1 < len(again)
        name += f" at {_told(clicks)}" + ", which has no smaller part there" * least
        sure = float(seeds[inside].sum() / seeds.sum())
        return replace(self._region(inside, name), sure=sure, is_least=least)

    def _around(self, click: Click) -> Selector:
        """The selector with the cameras that look at what is clicked, where these are few of all:
        in a long capture it would be seen by none of the VIEWS, or be in the background."""
        if len(self.cameras) <= VIEWS:
            return self
        weights = torch.from_numpy(self._seeds_of(click, self.scene))
        rows = weights.nonzero().squeeze(1)
        point = weighted_quantile(self.scene.means[rows].double(), weights[rows], 0.5)
        chosen = looking_at(point, click.camera, self.cameras)
        if len(chosen) >= 0.5 * len(self.cameras):  # the scene is of one place
            return self
        if chosen not in self._local:
            some = [self.cameras[i] for i in chosen]
            self._local[chosen] = Selector(self.scene, some, self._groups)
        return self._local[chosen]

    def box(self, camera: Camera, x0: float, y0: float, x1: float, y1: float) -> Region:
        """Select the objects that are mostly inside a box of a view; corners in pixels."""
        columns = torch.arange(camera.width) + 0.5
        rows = torch.arange(camera.height) + 0.5
        across = (columns >= min(x0, x1)) & (columns < max(x0, x1))
        down = (rows >= min(y0, y1)) & (rows < max(y0, y1))
        mask = (down[:, None] & across).float()
        if not mask.any():
            raise UsageError(f"the box holds no pixel of the {camera.width}x{camera.height} view")
        return self._of_mask(camera, mask, "in the box", drawn=False)

    def mask(self, camera: Camera, mask: Float[Tensor, "h w"]) -> Region:
        """Select what a mask of a view covers, 1 inside: whole objects that are mostly in it, or
        the part of one that it shows, continued around it."""
        if tuple(mask.shape) != (camera.height, camera.width):
            shape = f"{camera.width}x{camera.height}"
            raise UsageError(
                f"the mask has {mask.shape[1]}x{mask.shape[0]} pixels, its view {shape}"
            )
        if not mask.any():
            raise UsageError("the mask is empty: draw white where the object is")
        return self._of_mask(camera, mask, "in the mask", drawn=True)

    @torch.no_grad()
    def _of_mask(
        self, camera: Camera, mask: Float[Tensor, "h w"], note: str, *, drawn: bool
    ) -> Region:
        held = self._weights(camera, mask)
        shown = self._weights(camera, torch.ones_like(mask))
        of_mask, of_view = self._by_label(held), self._by_label(shown)
        filled = of_mask / max(float(of_mask.sum()), 1e-9)
        things = [
            i for i in range(len(filled)) if i < len(self._found.objects) and filled[i] >= PART / 2
        ]
        # most of what the view shows of a thing is inside
        chosen = [i for i in things if of_mask[i] >= 0.6 * of_view[i]]
        if chosen:
            return self._region(np.isin(self._labels, chosen), f"objects {note}")
        if not things and not drawn:
            raise UsageError("no object is in the box: draw it around one")
        best = max(things, key=lambda i: of_mask[i]) if things else int(of_mask.argmax())
        return self._region(self._shown_part(best, held, shown), f"part of an object {note}")

    def _shown_part(
        self, label: int, held: Float64[np.ndarray, " n"], shown: Float64[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """The part of a segment in a mask, continued where its view does not show it."""
        share = held / np.maximum(shown, 1e-9)
        seen = shown > 1e-3
        values = np.where(seen, share, 0.5)
        confidence = np.where(seen, shown / np.median(shown[seen]), 0.0).clip(max=1)
        rows = np.flatnonzero(self._labels == label)
        out = np.zeros(len(self._labels), bool)
        out[rows] = self._solved(rows, values[rows], confidence[rows]) > 0.5
        return out

    def _refined(self, inside: Bool[np.ndarray, " n"], click: Click) -> Bool[np.ndarray, " n"]:
        """The selection with or without what a further click hits: a whole object or piece of one
        color where it is about as wide as the click is far from the selection's border, else what
        is alike within that distance."""
        weights = self._seeds_of(click)
        held = weights[inside].sum() > 0.5 * weights.sum()
        if bool(held) == click.inside or not weights.any():
            return inside  # it is so already
        middle = np.average(self._surfaces.points, axis=0, weights=weights)
        reach = self._reach(inside, click, middle)
        hit = self._hit(inside, click, weights)
        points = self._surfaces.points
        if hit is not None and extent_of(points[hit]) <= WHOLE * reach:
            return inside | hit if click.inside else inside & ~hit
        away = np.linalg.norm(points - middle, axis=1) / (AROUND * reach)
        rows = np.flatnonzero(away < 1)
        seed = weights[rows] > SEEDS * weights.max()
        if not seed.any():
            return inside
        values = np.where(seed, float(click.inside), inside[rows].astype(float))
        out = inside.copy()
        out[rows] = self._solved(rows, values, np.where(seed, SEED, PRIOR * away[rows] ** 4)) > 0.5
        return out

    def _without_support(
        self, inside: Bool[np.ndarray, " n"], click: Click, first: Click
    ) -> Bool[np.ndarray, " n"]:
        """The selection without the level patch that a click outside hits and what is below it,
        where the first click is above: what was clicked stands on that."""
        if click.inside:
            return inside
        points = self._surfaces.points
        weights = self._seeds_of(click) * inside
        first_at = np.average(points, axis=0, weights=self._seeds_of(first))[None]
        for patch in level_patches(self._surfaces, inside):
            hit = weights[patch.rows].sum() > 0.5 * weights.sum()
            if hit and patch.above(first_at)[0] and patch.over(first_at)[0]:
                return inside & patch.above(points)
        return inside

    def _hit(
        self, inside: Bool[np.ndarray, " n"], click: Click, weights: Float64[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"] | None:
        """The object that a click hits beside the selection, or the piece of the selection."""
        if click.inside:
            label = int(self._by_label(weights * ~inside).argmax())
            return self._labels == label if label < len(self._found.objects) else None
        solid = inside & self._surfaces.solid
        piece = pieces(self._surfaces, solid)
        held = np.bincount(piece[solid], weights=weights[solid], minlength=1)
        if not held.any():
            return None
        return self._surfaces.spread(piece == held.argmax(), solid, inside & ~solid)

    def _reach(
        self, inside: Bool[np.ndarray, " n"], click: Click, middle: Float64[np.ndarray, "3"]
    ) -> float:
        """Distance of a click from the border of the selection in its view, world units."""
        from scipy.ndimage import distance_transform_edt  # takes 0.4 s: only clicks need it

        camera = click.camera.fitted(VIEW_PIXELS)
        scale = camera.width / click.camera.width
        colors = torch.from_numpy(inside).float()[:, None].expand(-1, 3).contiguous()
        weights = color_weights(self._surfaces.scene, camera)
        shown = (weights.picture(colors)[..., 0] > 0.5).numpy()
        x, y = (int(value * scale) for value in (click.x, click.y))
        same = shown == shown[y, x]
        pixels = float(np.asarray(distance_transform_edt(np.pad(same, 1)))[y + 1, x + 1])
        depth = float(camera.project(torch.from_numpy(middle))[1])
        return pixels / camera.fx * (depth if camera.model == "pinhole" else 1.0)

    def _solved(
        self,
        rows: Int[np.ndarray, " m"],
        values: Float64[np.ndarray, " m"],
        confidence: Float64[np.ndarray, " m"],
    ) -> Float64[np.ndarray, " m"]:
        """Values that follow the given ones and those of neighbors alike, on some rows."""
        near = self._surfaces.graph[rows][:, rows]
        near.data = LEAST_AFFINITY + (1 - LEAST_AFFINITY) * near.data
        given = torch.from_numpy(values), torch.from_numpy(confidence)
        # values follow few clicked Gaussians from afar
        return smooth(*given, near, STRENGTH, tolerance=1e-5).numpy()

    def _label(self, weights: Float64[np.ndarray, " n"]) -> int:
        """The segment that gives most of a pixel. Raises UsageError for the background."""
        label = int(self._by_label(weights).argmax())
        kind = self._found.rows[label].kind
        if kind in ("background", "sky"):
            what = f"the click is on the {kind}: click on an object"
            raise UsageError(Said(what, "select-kind", kind=kind))
        return label

    def _by_label(self, weights: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " s"]:
        count = len(self._found.rows)
        return np.bincount(self._labels, weights=weights, minlength=count)

    def _seeds_of(self, click: Click, scene: Gaussians | None = None) -> Float64[np.ndarray, " n"]:
        """The weight of each Gaussian, or group of a large scene, in the pixels at a click.

        Raises UsageError beside the picture or on nothing."""
        camera, name = click.camera, click.name or "the view"
        if not (0 <= click.x < camera.width and 0 <= click.y < camera.height):
            raise UsageError(
                f"the click at {click.x:g},{click.y:g} is beside the picture of {name}, which has "
                f"{camera.width}x{camera.height} pixels"
            )
        side = 2 * HALF_WINDOW + 1
        left, top = int(click.x) - HALF_WINDOW, int(click.y) - HALF_WINDOW
        window = replace(camera, cx=camera.cx - left, cy=camera.cy - top, width=side, height=side)
        weights = self._weights(window, torch.ones(side, side), scene)
        if click.inside and weights.sum() < 0.2 * side**2:  # it shows nothing
            raise UsageError(
                f"nothing is at {click.x:g},{click.y:g} of {name}: click where the scene is opaque"
            )
        return weights

    def _weights(
        self, camera: Camera, values: Float[Tensor, "h w"], scene: Gaussians | None = None
    ) -> Float64[np.ndarray, " n"]:
        """The weight of each Gaussian in the pixels of a view, times values."""
        maps = values[..., None].expand(-1, -1, 3).contiguous()
        scene = scene or self._surfaces.scene
        pulled = color_weights(scene, camera).back(maps)
        return pulled[:, 0].double().numpy()

    def _region(self, inside: Bool[np.ndarray, " n"], note: str) -> Region:
        """The region of all Gaussians. Raises UsageError where it is empty or all."""
        flags = self._surfaces.expanded(torch.from_numpy(inside))
        if not flags.any():
            raise UsageError("nothing is selected: the clicks outside took everything away")
        if flags.all():
            raise UsageError(
                "the selection is the whole scene, which has no ground or background to tell it "
                "from: add clicks outside, or leave the selection out"
            )
        return Region(cut_out(self.scene, self.cameras, flags), note)

    @cached_property
    def _surfaces(self) -> Surfaces:
        return look(self.scene, self.cameras, self._groups)

    @cached_property
    def _found(self) -> Segments:
        return segment_surfaces(self._surfaces)

    @cached_property
    def _labels(self) -> Int[np.ndarray, " n"]:
        return self._found.labels.numpy()


def at_one_place(click: Click, first: Click) -> bool:
    """Whether both are inside, within SAME_PLACE of each other in one view."""
    one, other = click.camera, first.camera
    if not click.inside or (one.width, one.height) != (other.width, other.height):
        return False
    near = np.hypot(click.x - first.x, click.y - first.y) <= SAME_PLACE * one.width
    return bool(near and torch.equal(one.world_to_camera, other.world_to_camera))


def _told(clicks: Sequence[Click]) -> str:
    """Clicks as the command line has them."""
    return " ".join(
        f"{'' if each.inside else 'not:'}{each.name or 'view'}:{each.x:g},{each.y:g}"
        for each in clicks
    )
