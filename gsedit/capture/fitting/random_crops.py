"""Random crops of views, of all or of those in which a region shows.

`h w` pixels of a view; a crop is a square of `side` pixels with its top left corner at one of
`y x` places.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.dataset import View
from rasterizer.camera import Camera
from rasterizer.project import Box

MIN_SHOWN_SHARE = 1 / 255
"""A region shows in a pixel of which it is more than this: with less, no color of the region
changes an 8-bit picture by more than a step."""


def random_crop(camera: Camera, side: int, generator: torch.Generator) -> Box:
    """A square of `side` pixels inside the picture: (left, top, width, height).

    Corners are drawn up to half a crop outside and moved in, so that a pixel at a border is in half
    as many crops as one in the middle. Drawn inside only, a picture's outermost row would be in one
    crop where others are in `side`, and the borders of the edited views would keep their colors.
    """
    left = _corner(camera.width - side, side, generator)
    top = _corner(camera.height - side, side, generator)
    return left, top, side, side


def _corner(last: int, side: int, generator: torch.Generator) -> int:
    """Draw the start of a crop along one axis, from 0 to `last`."""
    drawn = int(torch.randint(-(side // 2), last + side // 2 + 1, (), generator=generator))
    return min(max(drawn, 0), last)


def random_patch(
    views: Sequence[View],
    shown: Sequence[Bool[Tensor, "h w"]] | None,
    side: int,
    generator: torch.Generator,
) -> tuple[View, Box]:
    """A random crop of a random view; the whole side where a picture is smaller.

    Where it is given what is `shown` in each view: one of the crops that hold such a pixel, each
    as probable among them as among all, so that crops at a border of what is shown are drawn as
    often as before beside those in its middle. Some crop must hold one.
    """
    side = min(side, *(min(v.camera.width, v.camera.height) for v in views))
    while True:
        index = int(torch.randint(len(views), (), generator=generator))
        box = random_crop(views[index].camera, side, generator)
        if shown is None or cut(shown[index], box).any():
            return views[index], box


def cut(picture: Tensor, box: Box) -> Tensor:
    """The pixels of a picture (its first two dimensions) in a box."""
    left, top, width, height = box
    return picture[top : top + height, left : left + width]


def crops_that_show(shown: Bool[Tensor, "h w"], side: int) -> Bool[Tensor, "y x"]:
    """Whether a pixel of each crop is `shown`, by the crop's top and left."""
    above = F.pad(shown.double().cumsum(0).cumsum(1), (1, 0, 1, 0))  # pixels above and left
    inside = above[side:] - above[:-side]
    return inside[:, side:] > inside[:, :-side]


def share_of_crops(shown: Sequence[Bool[Tensor, "h w"]], side: int) -> float:
    """The probability that a random crop of a random view holds a pixel that is `shown`."""
    side = min(side, *(min(view.shape) for view in shown))  # as `random_patch` draws them
    shares = []
    for view in shown:
        touched = crops_that_show(view, side).double()
        top, left = (_times_drawn(size, side) for size in touched.shape)
        shares.append(float(top @ touched @ left))
    return sum(shares) / len(shares)


def _times_drawn(places: int, side: int) -> Float[Tensor, " y"]:
    """The probability of each place of `random_crop` along one axis."""
    times = torch.ones(places, dtype=torch.float64)
    times[0] += side // 2
    times[-1] += side // 2
    return times / times.sum()


def shown_at(shown: Bool[Tensor, "h w"], width: int, height: int) -> Bool[Tensor, "y x"]:
    """Reduce a mask to a smaller size: True where any pixel is shown."""
    if shown.shape == (height, width):
        return shown
    return F.adaptive_max_pool2d(shown[None].float(), (height, width))[0] > 0


def crops_needed(patches: int, share: float) -> int:
    """Number of crops that show the region, of `patches` random ones, rounded up; at least 1."""
    return max(1, ceil(patches * share - 1e-9))
