"""Layers of the small network: the U-Net, its attention, and the MLP that works pixel by pixel.

`b` images, `c` channels, `y x` cells of 4x4 pixels, `e` channels of the embedding.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

HEAD_CHANNELS = 32  # of an attention head
GROUPS = 8  # of a group norm


class PixelMLP(nn.Module):
    """Three layers on every pixel alone; an embedding modulates the first two (FiLM)."""

    def __init__(self, in_channels: int, width: int, embedding: int) -> None:
        super().__init__()
        self.first, self.second = nn.Linear(in_channels, width), nn.Linear(width, width)
        self.last = nn.Linear(width, 6)
        self.film = nn.ModuleList(nn.Linear(embedding, 2 * width) for _ in range(2))
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(
        self, pixels: Float[Tensor, "b n p"], embedding: Float[Tensor, "b e"]
    ) -> Float[Tensor, "b n 6"]:
        """Two colours to add: one everywhere, one on the subject alone."""
        h = pixels
        for layer, film in zip((self.first, self.second), self.film):
            scale, shift = film(embedding)[:, None].chunk(2, -1)
            weight = layer.weight.T * (1 + scale)  # per image: the product costs nothing more
            h = F.silu(
                torch.baddbmm((layer.bias * (1 + scale) + shift).to(h.dtype), h, weight.to(h.dtype))
            )
        return self.last(h)


class UNet(nn.Module):
    """Features of every cell at several scales; the embedding, if any, modulates every level."""

    def __init__(
        self, in_channels: int, widths: Sequence[int], embedding: int | None, attention_levels: int
    ) -> None:
        """`widths`: channels per level; the lowest `attention_levels` levels have attention."""
        super().__init__()
        self.conv_in = nn.Conv2d(in_channels, widths[0], 3, padding=1)
        self.down, self.up = nn.ModuleList(), nn.ModuleList()
        for level, width in enumerate(widths):
            attention = level >= len(widths) - attention_levels
            above, below = widths[max(level - 1, 0)], widths[min(level + 1, len(widths) - 1)]
            self.down.append(UNetLevel((above, width), embedding, attention=attention))
            self.up.append(UNetLevel((below + width, width), embedding, attention=attention))
        bottom = (widths[-1], widths[-1])
        self.middle = UNetLevel(bottom, embedding, attention=attention_levels > 0)
        self.norm = nn.GroupNorm(GROUPS, widths[0])

    def forward(
        self, cells: Float[Tensor, "b c y x"], embedding: Float[Tensor, "b e"] | None
    ) -> Float[Tensor, "b d y x"]:
        """`y` and `x` are multiples of 2 to the power of the levels below the first."""
        h, skips = self.conv_in(cells), []
        for level, block in enumerate(self.down):
            h = block(F.avg_pool2d(h, 2) if level else h, embedding)
            skips.append(h)
        h = self.middle(h, embedding)
        for level, block in reversed(list(enumerate(self.up))):
            h = block(torch.cat((h, skips[level]), 1), embedding)
            h = F.interpolate(h, scale_factor=2.0, mode="nearest") if level else h
        return self.norm(h)


class UNetLevel(nn.Module):
    """A residual block of two convolutions, modulated in between; then attention, if any."""

    def __init__(self, widths: Sequence[int], embedding: int | None, *, attention: bool) -> None:
        """`widths`: channels that come in and that go out."""
        super().__init__()
        in_channels, width = widths
        self.norm1, self.norm2 = nn.GroupNorm(GROUPS, in_channels), nn.GroupNorm(GROUPS, width)
        self.conv1 = nn.Conv2d(in_channels, width, 3, padding=1)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1)
        self.film = None if embedding is None else nn.Linear(embedding, 2 * width)
        self.skip = nn.Conv2d(in_channels, width, 1) if in_channels != width else nn.Identity()
        self.attention = Attention(width) if attention else None
        nn.init.zeros_(self.conv2.weight)

    def forward(
        self, x: Float[Tensor, "b c y x"], embedding: Float[Tensor, "b e"] | None
    ) -> Float[Tensor, "b d y x"]:
        h = self.norm2(self.conv1(F.silu(self.norm1(x))))
        if self.film is not None:
            h = modulated(h, self.film(embedding))
        h = self.skip(x) + self.conv2(F.silu(h))
        return h if self.attention is None else self.attention(h)


class Attention(nn.Module):
    """Self-attention of every cell to all cells."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(GROUPS, width)
        self.qkv, self.out = nn.Conv2d(width, 3 * width, 1), nn.Conv2d(width, width, 1)
        nn.init.zeros_(self.out.weight)

    def forward(self, x: Float[Tensor, "b c y x"]) -> Float[Tensor, "b c y x"]:
        b, c, y, w = x.shape
        qkv = self.qkv(self.norm(x)).reshape(b, 3, c // HEAD_CHANNELS, HEAD_CHANNELS, y * w)
        q, k, v = qkv.transpose(-1, -2).unbind(1)
        values = F.scaled_dot_product_attention(q, k, v)
        return x + self.out(values.transpose(-1, -2).reshape(b, c, y, w))


def modulated(h: Float[Tensor, "b c y x"], film: Float[Tensor, "b d"]) -> Float[Tensor, "b c y x"]:
    """Scaled by 1 + the first half of `film`, shifted by the second, per channel; d = 2c."""
    scale, shift = film[:, :, None, None].chunk(2, 1)
    return h * (1 + scale) + shift
