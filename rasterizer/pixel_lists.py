"""Lists of the Gaussians that each pixel of a view shows, for pictures of other colors at once.

While no Gaussian moves, a pixel shows the same ones in the same order, and each one's alpha is its
opacity times a constant. A list of them a pixel is made once a view; a picture, or any crop of it,
then needs no projection, no sorting and no tiles, and costs what its own pixels show.

`e` entries (pixel, Gaussian), `p` pixels, `n` Gaussians, of which a picture shows `m`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from rasterizer.blending.backend import BlendInputs
from rasterizer.blending.torch_backend import BACKEND, pixel_entries
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, DEFAULT, Numerics
from rasterizer.preprocess import preprocess, stored_scene
from rasterizer.project import Box
from rasterizer.scene import Gaussians
from rasterizer.splat import list_tiles
from rasterizer.tiles import stable_argsort

MIN_LISTED_WEIGHT = 1 / 1024
"""Weight in a pixel, of 1: what shows less is not listed. All of it is 0.1 to 0.2 % of the bear's
pictures, and half of the entries."""


@dataclass(frozen=True, eq=False)
class PixelLists:
    """Gaussians that pixels show, front to back, at the opacities that the lists were made with."""

    rows: Int[Tensor, " e"]
    """Row numbers in the scene; int32."""
    alphas: Float[Tensor, " e"]
    starts: Int[Tensor, " p1"]
    """Pixel i shows the entries starts[i] : starts[i + 1]; pixels are row by row."""
    width: int
    """Picture width, pixels; its height is below."""
    height: int

    def crop(self, box: Box) -> PixelLists:
        """The lists of the pixels of a box."""
        left, top, width, height = box
        first = (top + torch.arange(height)) * self.width + left
        begins, ends = self.starts[first].tolist(), self.starts[first + width].tolist()
        counts = self.starts[first[:, None] + torch.arange(width + 1)].diff().flatten()
        spans = [slice(*span) for span in zip(begins, ends)]
        return PixelLists(
            rows=torch.cat([self.rows[span] for span in spans]),
            alphas=torch.cat([self.alphas[span] for span in spans]),
            starts=torch.cat((counts.new_zeros(1), counts.cumsum(0))),
            width=width,
            height=height,
        )


@torch.no_grad()
def pixel_lists(
    scene: Gaussians,
    camera: Camera,
    numerics: Numerics = DEFAULT,
    *,
    least: float = MIN_LISTED_WEIGHT,
) -> PixelLists:
    """The lists of a view, from the scene's geometry and opacities; weights below `least` are out.

    Raises ValueError as `render` does, but for colors, which are not read.
    """
    box = (0, 0, camera.width, camera.height)
    splats = preprocess(stored_scene(scene), camera, box, numerics)
    xy, bins = list_tiles(splats, box, numerics, AUTO, BACKEND)
    table = torch.cat((xy, splats.projected.whitening, splats.log_opacities[:, None]), -1)
    inputs = BlendInputs(table, bins, camera.width, camera.height, numerics)
    entries = pixel_entries(inputs, least)
    pixels = camera.width * camera.height
    order = stable_argsort(entries.pixel, pixels)  # front to back stays front to back
    counts = torch.bincount(entries.pixel, minlength=pixels)
    return PixelLists(
        rows=splats.rows.int().index_select(0, entries.member.index_select(0, order)),
        alphas=entries.alpha.index_select(0, order),
        starts=torch.cat((counts.new_zeros(1), counts.cumsum(0))),
        width=camera.width,
        height=camera.height,
    )


def shown_rows(lists: Sequence[PixelLists], count: int) -> Int[Tensor, " m"]:
    """The rows, of `count`, that any of the lists has; they ascend."""
    shown = torch.zeros(count, dtype=torch.bool)
    for each in lists:
        shown[each.rows] = True
    return shown.nonzero().squeeze(-1)


def blend(
    lists: PixelLists,
    places: Int[Tensor, " n"],
    colors: Float[Tensor, "m 3"],
    gains: Float[Tensor, " m"],
    numerics: Numerics = DEFAULT,
) -> Float[Tensor, "h w 3"]:
    """The picture over black; differentiable in `colors` and in `gains`.

    `places` of a Gaussian that is shown is its row of the others. `gains` are the factors of the
    opacities since the lists were made.
    """
    index = places.index_select(0, lists.rows)
    picture = _Blend.apply(colors, gains, index, lists.alphas, lists.starts, numerics.alpha_max)
    return picture.view(lists.height, lists.width, 3)


class _Blend(torch.autograd.Function):
    """`composite` (rasterizer/blending), for lists a pixel and not a tile."""

    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any,
        colors: Float[Tensor, "m 3"],
        gains: Float[Tensor, " m"],
        index: Int[Tensor, " e"],
        alphas: Float[Tensor, " e"],
        starts: Int[Tensor, " p1"],
        alpha_max: float,
    ) -> Float[Tensor, "p 3"]:
        alphas = (alphas * gains.index_select(0, index)).clamp_max_(alpha_max)
        counts = starts.diff()
        # logarithms are summed over all pixels: float32 has too few digits
        passing = torch.log1p(-alphas).double()
        before = passing.cumsum(0).sub_(passing)
        in_front = before.sub_(_at_starts(before, starts, counts)).to(alphas.dtype).exp_()
        weights = in_front * alphas
        ctx.save_for_backward(colors, gains, index, alphas, in_front, weights, starts)
        ctx.alpha_max = alpha_max
        first = starts[:-1].to(index.dtype)
        return embedding_bag(index, colors, first, mode="sum", per_sample_weights=weights)

    @staticmethod
    def backward(ctx: Any, upstream: Float[Tensor, "p 3"]) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        colors, gains, index, alphas, in_front, weights, starts = ctx.saved_tensors
        counts, at = starts.diff(), index.long()
        value = torch.zeros_like(weights)
        grad_colors = torch.empty_like(colors)
        for channel in range(3):
            g = upstream[:, channel].repeat_interleave(counts, output_size=len(index))
            value.addcmul_(g, colors[:, channel].contiguous().index_select(0, index))
            sums = colors.new_zeros(len(colors)).scatter_add_(0, at, g.mul_(weights))
            grad_colors[:, channel] = sums
        if not ctx.needs_input_grad[1]:
            return grad_colors, None, None, None, None, None
        gain = (weights * value).double()
        through = gain.cumsum(0)
        ends = torch.cat((through.new_zeros(1), through)).index_select(0, starts[1:])
        behind = ends.repeat_interleave(counts, output_size=len(index)).sub_(through).to(value)
        slope = in_front.mul(value).mul_(alphas).sub_(behind.mul_(alphas).div_(1 - alphas))
        slope *= alphas < ctx.alpha_max
        grad_gains = torch.zeros_like(gains).scatter_add_(0, at, slope)
        return grad_colors, grad_gains / gains, None, None, None, None


def _at_starts(
    values: Float[Tensor, " e"], starts: Int[Tensor, " p1"], counts: Int[Tensor, " p"]
) -> Float[Tensor, " e"]:
    """At every entry, the value at the first entry of its pixel."""
    first = torch.cat((values, values.new_zeros(1))).index_select(0, starts[:-1])
    return first.repeat_interleave(counts, output_size=len(values))
