"""What makes a picture look like another one: Gram matrices of features, and what is kept.

`n` pictures of `h w` pixels, `c` channels of `y x` positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.measures.losses import gram, mse
from gsedit.points.color_space import LUMINANCE

CONTENT_OCTAVES = slice(1, None)
"""Of the filter bank, that content is kept in: strokes may be drawn in the finest."""


class StyleLoss:
    """How far pictures are from the style of one, and from their own content."""

    def __init__(
        self, picture: Float[Tensor, "h w 3"], features: FeatureExtractor, content: float
    ) -> None:
        """`picture` in [0, 1] has the style; `content` is the weight of what is kept."""
        self.features, self.content, self.bank = features, content, FilterBank()
        with torch.no_grad():
            self.target = [gram(layer) for layer in features(_channels_first(picture))]

    def __call__(
        self,
        drawn: Float[Tensor, "h w 3"],
        before: Float[Tensor, "h w 3"],
        mask: Float[Tensor, "h w"],
    ) -> Float[Tensor, ""]:
        """Of a drawn picture, which was `before`; only the style of what is in `mask` counts.

        Style: squared differences of Gram matrices (Gatys et al. 2016) relative to the square of
        the picture's own, summed over layers. Content: MSE of the octaves of a filter bank.
        """
        now = _channels_first(drawn)
        grams = [gram(_masked(layer, mask)) for layer in self.features(now)]
        style = [
            (ours - goal).square().sum() / goal.square().sum()
            for ours, goal in zip(grams, self.target, strict=True)
        ]
        old = self.bank(_channels_first(before))[CONTENT_OCTAVES]
        new = self.bank(now)[CONTENT_OCTAVES]
        kept = [mse(a, b) for a, b in zip(new, old, strict=True)]
        return torch.stack(style).sum() + self.content * torch.stack(kept).sum()


def _channels_first(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "1 3 h w"]:
    return picture.movedim(-1, 0)[None]


def _masked(
    layer: Float[Tensor, "n c y x"], mask: Float[Tensor, "h w"]
) -> Float[Tensor, "n c y x"]:
    """The layer scaled so that its Gram matrix is the mean over the mask."""
    height, width = layer.shape[-2:]
    small = F.adaptive_avg_pool2d(mask[None, None], (height, width))
    return layer * (small / small.mean().clamp_min(1e-6)).sqrt()


@torch.no_grad()
def edges(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "y x"]:
    """Strength of the edges of luma (Sobel), of pixels two by two."""
    luma = picture @ torch.tensor(LUMINANCE, dtype=picture.dtype)
    slope = torch.tensor([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
    kernels = torch.stack((slope, slope.T))[:, None].to(luma)
    return F.conv2d(F.avg_pool2d(luma[None, None], 2), kernels)[0].norm(dim=0)


def structure_kept(
    pictures: Sequence[Float[Tensor, "h w 3"]], originals: Sequence[Float[Tensor, "h w 3"]]
) -> float:
    """Correlation of the edges of pictures with those of the originals, the mean over pictures: 1
    where no edge came or went, about 0 for unrelated pictures."""
    pairs = zip(pictures, originals, strict=True)
    each = [
        torch.corrcoef(torch.stack((edges(a).flatten(), edges(b).flatten())))[0, 1]
        for a, b in pairs
    ]
    return float(torch.stack(each).nan_to_num(0).mean())
