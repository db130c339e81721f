"""Views of a person: the first one, one that frames a part; and places at which objects are seen.

`n` Gaussians; positions in world units, places in a picture as shares of its width and height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.app.document import Eye
from gsedit.scene.framing import bounds
from rasterizer.camera import Camera
from rasterizer.color_weights import color_weights
from rasterizer.scene import Gaussians

if TYPE_CHECKING:
    from gsedit.select.segment import Segments

ABOVE = 0.3
"""Sine of the height over a subject that shows its top and front: 17 degrees."""
ROOM = 1.0
"""Radii of what is framed that fill the shorter side of the picture."""
MARKS, MARK_SEEN, MARK_PIXELS = 9, 0.002, 256
"""Most objects that are numbered at once, one key each; least share of the picture that one fills;
and the longer side at which they are looked for."""


def best_of(cameras: Sequence[Camera], place: Float[Tensor, "3"], up: Float[Tensor, "3"]) -> Camera:
    """The camera that shows a place best: in the middle, from a little above, and neither nearer
    nor farther than most."""
    away = torch.stack([each.center.double() - place for each in cameras])
    far = away.norm(dim=1)
    heights = (away @ up.double()) / far.clamp_min(1e-9)
    off = torch.tensor([_off_middle(each, place) for each in cameras], dtype=torch.float64)
    badness = off + (far / far.median()).clamp_min(1e-9).log().abs() + (heights - ABOVE).abs()
    return cameras[int(badness.argmin())]


def _off_middle(camera: Camera, place: Float[Tensor, "3"]) -> float:
    places, depth = camera.project(place[None].to(camera.world_to_camera))
    x, y = (places[0] / places.new_tensor((camera.width, camera.height)) - 0.5).tolist()
    return float(max(abs(x), abs(y))) if float(depth[0]) > 0 else 9.0


def framed(scene: Gaussians, inside: Bool[Tensor, " n"], eye: Eye) -> Eye:
    """The eye moved along its direction, or to it, so that what is inside fills the picture."""
    ball = bounds(scene[inside], alone=True)
    position, target = (
        torch.tensor(each, dtype=torch.float64) for each in (eye.position, eye.target)
    )
    away = torch.nn.functional.normalize(position - target, dim=0)
    distance = ROOM * ball.radius / torch.sin(torch.tensor(eye.fov / 2)).item()
    x, y, z = (torch.tensor(ball.center, dtype=torch.float64) + distance * away).tolist()
    return replace(eye, position=(x, y, z), target=ball.center)


@dataclass(frozen=True)
class Mark:
    """An object of the scene in one picture."""

    number: int
    x: float
    y: float


def marks(scene: Gaussians, segments: Segments, camera: Camera) -> tuple[Mark, ...]:
    """The objects that a picture shows, the largest ones, where most of each is seen."""
    camera = camera.fitted(MARK_PIXELS)
    h, w, count = camera.height, camera.width, len(segments.objects)
    down, across = torch.meshgrid(torch.arange(h), torch.arange(w), indexing="ij")
    maps = torch.stack((torch.ones(h, w), (across + 0.5) / w, (down + 0.5) / h), -1)
    pulled = color_weights(scene, camera).back(maps)
    held = torch.zeros(len(segments.rows), 3).index_add_(0, segments.labels.long(), pulled)[:count]
    seen = held[:, 0] / (h * w)
    largest = seen.argsort(descending=True)[:MARKS].tolist()
    return tuple(
        Mark(i, *(held[i, 1:] / held[i, 0]).tolist()) for i in largest if seen[i] >= MARK_SEEN
    )
