"""Points on the surfaces of posed photos, by a plane sweep (Collins 1996).

Every photo gets a grid of small patches. A patch is moved through a series of depths; where it
agrees best with the neighbouring photos, there is the surface. This reaches what the sparse points
of a reconstruction leave empty, and starts a fit to photos that have none.

`p` patches of a photo, of `s` pixels each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import ceil, gcd, sqrt

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.views.dataset import View
from rasterizer.camera import Camera

SIDE = 160
"""Pixels on the longer side of the pictures that are compared."""
RADIUS, SPACING = 2, 2
"""A patch is a square of pixels that reach so far, so far apart: 3x3 of them."""
PIXELS = 25
"""Of a compared picture, at least so many for each patch: they do not overlap. With 4, 40 photos of
64 pixels give three times the Gaussians, and a fit of 5 CPU seconds 2.5 dB less."""
DEPTHS = 32
"""Of a sweep, evenly spaced in their inverse, as a patch's places in a neighbour then are."""
NEIGHBOURS = 3
"""Photos that one is compared with. The worst does not count: something may hide the place."""
AGREEMENT = 0.6
"""Smallest normalised correlation of a patch with the neighbours."""
FLAT = 0.01
"""The standard deviation of grey values below which a patch does not show its depth."""


@torch.no_grad()
def swept_points(
    views: Sequence[View],
    count: int,
    inverse_depths: tuple[float, float],
    generator: torch.Generator,
    out_of_time: Callable[[], bool] = lambda: False,
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """(places, colours) that photos agree on: of about `count` patches, the good ones.

    `inverse_depths`: the smallest and the largest that are tried, above 0. `out_of_time` is asked
    before each photo: the rest give none.
    """
    small = cache(lambda row: _small(views[row]))  # read when it is needed
    centres = torch.stack([view.camera.centre for view in views])
    axes = torch.stack([view.camera.forward for view in views])
    places, colours = [torch.zeros(0, 3)], [torch.zeros(0, 3)]
    for i in _spread(len(views)):
        if out_of_time():
            break
        if neighbours := _neighbours(centres, axes, i):
            view, others = small(i), [small(j) for j in neighbours]
            most = view.camera.width * view.camera.height // PIXELS
            wanted = min(ceil(count / len(views)), most)
            patches = _grid(view, max(1, wanted), generator)
            depth, good = _sweep(view, others, patches, inverse_depths)
            good &= _supervised(view, patches)
            places.append(view.camera.unproject(patches[good], depth[good]))
            colours.append(_sampled(view.image, view.camera, patches[good]))
    return torch.cat(places), torch.cat(colours)


def _spread(count: int) -> list[int]:
    """0 to `count` - 1 such that the first few are spread over all: neighbours come in turn."""
    stride = next(
        step for step in range(round(0.38 * count) or 1, count + 1) if gcd(step, count) == 1
    )
    return [i * stride % count for i in range(count)]


def _small(view: View) -> View:
    camera = view.camera.fitted(SIDE)
    return view.resized(camera.width, camera.height)


def _neighbours(centres: Float[Tensor, "v 3"], axes: Float[Tensor, "v 3"], i: int) -> list[int]:
    """The cameras nearest to camera i, elsewhere, that look about the same way: within 60 degrees.

    `axes`: along which they look, of length 1.
    """
    distances = (centres - centres[i]).norm(dim=-1)
    candidates = ((axes @ axes[i] > 0.5) & (distances > 0)).nonzero().squeeze(-1)
    order = distances[candidates].argsort(stable=True)[:NEIGHBOURS]
    return candidates[order].tolist()


def _grid(view: View, count: int, generator: torch.Generator) -> Float[Tensor, "p 2"]:
    """About `count` pixel positions, one at a random place in each square of a grid."""
    width, height = view.camera.width, view.camera.height
    step = sqrt(width * height / count)
    corners = torch.cartesian_prod(torch.arange(0, width, step), torch.arange(0, height, step))
    places = corners + step * torch.rand(len(corners), 2, generator=generator)
    return torch.minimum(places.clamp_min(RADIUS), places.new_tensor((width, height)) - RADIUS)


def _sweep(
    view: View,
    others: Sequence[View],
    centres: Float[Tensor, "p 2"],
    inverse_depths: tuple[float, float],
) -> tuple[Float[Tensor, " p"], Bool[Tensor, " p"]]:
    """The best depth of each patch, to a fraction of a step, and whether photos agree on it."""
    offsets = torch.arange(-RADIUS, RADIUS + 1, SPACING).float()
    pixels = centres[:, None] + torch.cartesian_prod(offsets, offsets)
    own, deviation = _normalised(_sampled(_grey(view), view.camera, pixels)[..., 0])
    low, high = inverse_depths
    step = (high - low) / DEPTHS
    inverse = low + step * (torch.arange(DEPTHS) + 0.5)
    match = torch.stack([_agreement(view, own, pixels, other, inverse) for other in others])
    match = match.sort(0, descending=True).values[: max(1, len(others) - 1)].mean(0)
    best, index = match.max(0)
    inner = index.clamp(1, DEPTHS - 2)
    before, at, after = (match.gather(0, (inner + k)[None])[0] for k in (-1, 0, 1))
    peak = (after - before) / (2 * (2 * at - before - after).clamp_min(1e-6))  # of the parabola
    shift = torch.where(inner == index, peak.clamp(-0.5, 0.5), 0.0)
    return 1 / (inverse[index] + step * shift), (best > AGREEMENT) & (deviation > FLAT)


def _agreement(
    view: View,
    own: Float[Tensor, "p s"],
    pixels: Float[Tensor, "p s 2"],
    other: View,
    inverse: Float[Tensor, " k"],
) -> Float[Tensor, "k p"]:
    """Correlation of each patch with another photo at each depth; -1 where that cannot be."""
    here, there, grey = view.camera, other.camera, _grey(other)
    relative = there.world_to_camera.double() @ here.world_to_camera.double().inverse()
    relative, size = relative.to(pixels), pixels.new_tensor((there.width, there.height))
    x, y = (pixels[..., 0] - here.cx) / here.fx, (pixels[..., 1] - here.cy) / here.fy
    turned = torch.stack((x, y, torch.ones_like(x)), -1) @ relative[:3, :3].T
    rows = []
    for one in inverse.tolist():
        x, y, z = (turned + one * relative[:3, 3]).unbind(-1)  # the place over its depth
        xy = torch.stack((there.fx * x / z + there.cx, there.fy * y / z + there.cy), -1)
        inside = (z > 0) & (xy > 0).all(-1) & (xy < size).all(-1)
        theirs, _ = _normalised(_sampled(grey, there, xy)[..., 0])
        rows.append(torch.where(inside.all(-1), (own * theirs).mean(-1), -1.0))
    return torch.stack(rows)


def _grey(view: View) -> Float[Tensor, "h w 1"]:
    return view.image.mean(-1, keepdim=True)


def _supervised(view: View, xy: Float[Tensor, "p 2"]) -> Bool[Tensor, " p"]:
    """Which pixel positions are neither masked nor transparent."""
    shown = torch.ones(len(xy), dtype=torch.bool)
    for kept in (view.mask, view.alpha):
        if kept is not None:
            shown &= _sampled(kept[..., None].float(), view.camera, xy)[:, 0] > 0.5
    return shown


def _sampled(
    image: Float[Tensor, "h w c"], camera: Camera, xy: Float[Tensor, "*p 2"]
) -> Float[Tensor, "*p c"]:
    """The picture at pixel positions, linear in between; the border's value beyond it."""
    size = xy.new_tensor((camera.width, camera.height))
    grid = (2 * xy / size - 1).nan_to_num(0).reshape(1, 1, -1, 2)
    values = torch.nn.functional.grid_sample(
        image.movedim(-1, 0)[None], grid, align_corners=False, padding_mode="border"
    )
    return values[0, :, 0].T.reshape(*xy.shape[:-1], image.shape[-1])


def _normalised(values: Float[Tensor, "p s"]) -> tuple[Float[Tensor, "p s"], Float[Tensor, " p"]]:
    """With mean 0 and standard deviation 1; and what that was."""
    centred = values - values.mean(-1, keepdim=True)
    deviation = centred.square().mean(-1).sqrt()
    return centred / deviation.clamp_min(1e-4)[:, None], deviation
