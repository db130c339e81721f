"""The network of `small`: it looks at the picture once, and then denoises its edit step by step.

`b` pictures, `y x` cells of 4x4 pixels, 48 channels: the pixels of a cell, colour by colour. Its
two parts are an eye, which sees the unedited picture and nothing else (so it works once an edit,
and no noise blurs what it sees), and a hand, which sees the noised edit, the noise level, the
instruction and what the eye has to tell. The eye is taught where the main subject is, how far
things are and which faces look up, since these decide where an edit acts. The answer is

  mean = c + g + m s + r               c the unedited pixels, m the share of the main subject
  x0   = w x_t / a + (1 - w) mean      w = spread^2 / (spread^2 + sigma^2)

g and s, one for everything and one for the subject alone, come from a small perceptron that sees
one pixel's colour and what the eye says of it, and that the instruction modulates (FiLM, Perez et
al. 2018): most looks are a function of colour, place and shape. r is whatever they are not. The
second line is the posterior mean of a pixel known to be within `spread` of `mean`: what is hardly
noised is kept, what is pure noise is ignored, and v = (a x_t - x0) / b (Salimans and Ho 2022) stays
bounded at both ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.editors.small.text import TextEncoder

CELL = 4
CHANNELS = 3 * CELL * CELL
SPREAD = 0.15  # of values in [-1, 1]: about how far off the network's mean is where it is unsure
TAUGHT = (0.02, 360.0)  # of sigma: the range of train_small.training
LOUD = 4.0  # noise of a sigma above this is turned down before the hand sees it
SEEN = 3  # what the eye is taught of every pixel: subject, depth, height of the normal
WAVES = 16  # frequencies of the noise level's embedding
HEAD = 32  # channels of an attention head
GROUPS = 8


def to_cells(images: Float[Tensor, "b h w 3"]) -> Float[Tensor, "b 48 y x"]:
    """Of values in [0, 1]: a cell's 4x4 pixels, in [-1, 1], become channels."""
    return F.pixel_unshuffle((2 * images - 1).movedim(-1, 1), CELL)


def from_cells(cells: Float[Tensor, "b 48 y x"]) -> Float[Tensor, "b h w 3"]:
    """The exact inverse of to_cells."""
    return F.pixel_shuffle(cells, CELL).movedim(1, -1) / 2 + 0.5


class Seen(NamedTuple):
    """What the eye makes of pictures."""

    features: Float[Tensor, "b c y x"]
    pixels: Float[Tensor, "b p h w"]
    """Of every pixel: first the three of `geometry`, then what is left to the network."""

    @property
    def geometry(self) -> Float[Tensor, "b 3 h w"]:
        """Log odds of being of the main subject; 1 / depth; height of the normal."""
        return self.pixels[:, :SEEN]


@dataclass(frozen=True)
class Architecture:
    """Sizes of the network; kept in the weights' metadata."""

    eye: tuple[int, ...] = (64, 96, 160, 192)
    """Channels per level; each halves the sides of the one before."""
    hand: tuple[int, ...] = (48, 64, 96)
    attended: int = 2
    """The eye's lowest levels, which look at all of the picture at once."""
    pixel: int = 12
    """What the eye says of every pixel."""
    perceptron: int = 32
    embedding: int = 256
    text_width: int = 128
    text_layers: int = 2

    @property
    def multiple(self) -> int:
        """Cells: sides are padded to multiples of it inside."""
        return 2 ** (max(len(self.eye), len(self.hand)) - 1)


class Network(nn.Module):
    """See the module's docstring."""

    def __init__(self, architecture: Architecture | None = None) -> None:
        super().__init__()
        self.architecture = a = architecture or Architecture()
        self.text = TextEncoder(a.text_width, a.text_layers, heads=a.text_width // HEAD)
        self.eye = UNet(CHANNELS + 1, a.eye, None, a.attended)
        self.say = nn.Conv2d(a.eye[0], a.pixel * CELL * CELL, 3, padding=1)
        self.told = nn.Linear(a.text_width, a.embedding)
        self.noise = nn.Sequential(
            nn.Linear(2 * WAVES, a.embedding), nn.SiLU(), nn.Linear(a.embedding, a.embedding)
        )
        self.hand = UNet(2 * CHANNELS + a.eye[0], a.hand, a.embedding, 0)
        self.rest = nn.Conv2d(a.hand[0], CHANNELS, 3, padding=1)
        self.whole = nn.Linear(a.hand[0], a.embedding)
        self.perceptron = Perceptron(3 + a.pixel, a.perceptron, a.embedding)
        for parameter in self.rest.parameters():
            nn.init.zeros_(parameter)

    def look(self, picture: Float[Tensor, "b 48 y x"], shown: Float[Tensor, " b"]) -> Seen:
        """What there is to see in pictures; where `shown` is 0, in none, whatever is given."""
        y, x = picture.shape[-2:]
        mask = shown[:, None, None, None]
        seen = torch.cat((picture * mask, mask.expand(-1, 1, y, x)), 1)
        features = self.eye(self._whole(seen), None)[..., :y, :x]
        return Seen(features, F.pixel_shuffle(self.say(F.silu(features)), CELL))

    def forward(
        self,
        x: Float[Tensor, "b 48 y x"],
        sigma: Float[Tensor, " b"],
        picture: Float[Tensor, "b 48 y x"],
        shown: Float[Tensor, " b"],
        seen: Seen,
        told: Float[Tensor, "b d"],
    ) -> Float[Tensor, "b 48 y x"]:
        """x0 of x_t, which has unit power where it is all noise (a^2 + b^2 = 1; sigma = b / a).

        `seen` is what `look` says of the picture, `told` what `text` makes of the instruction.
        """
        y, w = x.shape[-2:]
        picture = picture * shown[:, None, None, None]
        level = sigma[:, None, None, None]
        quiet = x / (1 + level / LOUD)
        embedding = F.silu(self.told(told) + self.noise(_waves(sigma)))
        entering = self._whole(torch.cat((quiet, picture, seen.features.to(x.dtype)), 1))
        h = F.silu(self.hand(entering, embedding)[..., :y, :w])
        edit = self._painted(picture, seen, h, embedding) + self.rest(h).to(x.dtype)
        keep = SPREAD**2 / (SPREAD**2 + level**2)
        clean = x * (1 + level**2).sqrt()  # x_t / a
        return keep * clean + (1 - keep) * (picture + edit)

    def _painted(self, picture: Tensor, seen: Seen, h: Tensor, embedding: Tensor) -> Tensor:
        """g + m s, cell by cell."""
        shown = F.pixel_shuffle(picture, CELL).to(seen.pixels.dtype)
        pixels = torch.cat((shown, seen.pixels), 1).flatten(2).transpose(1, 2)
        told = embedding + F.silu(self.whole(h.mean((2, 3))))
        everywhere, subject = self.perceptron(pixels, told).chunk(2, -1)
        share = seen.geometry[:, :1].sigmoid().flatten(2).transpose(1, 2)
        edit = (everywhere + share * subject).transpose(1, 2).reshape(shown.shape)
        return F.pixel_unshuffle(edit, CELL).to(picture.dtype)

    def _whole(self, cells: Tensor) -> Tensor:
        """Continued to sides that every level can halve."""
        y, x = cells.shape[-2:]
        m = self.architecture.multiple
        return F.pad(cells, (0, -x % m, 0, -y % m), mode="replicate")


class Perceptron(nn.Module):
    """One pixel at a time: three layers, the first two modulated by an embedding (FiLM)."""

    def __init__(self, entering: int, width: int, embedding: int) -> None:
        super().__init__()
        self.first, self.second = nn.Linear(entering, width), nn.Linear(width, width)
        self.last = nn.Linear(width, 6)
        self.told = nn.ModuleList(nn.Linear(embedding, 2 * width) for _ in range(2))
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(
        self, pixels: Float[Tensor, "b n p"], embedding: Float[Tensor, "b e"]
    ) -> Float[Tensor, "b n 6"]:
        """Two colours: what to add everywhere, and on the subject alone."""
        h = pixels
        for layer, told in zip((self.first, self.second), self.told):
            scale, shift = told(embedding)[:, None].chunk(2, -1)
            weight = layer.weight.T * (1 + scale)  # per picture: the product costs nothing more
            h = F.silu(
                torch.baddbmm((layer.bias * (1 + scale) + shift).to(h.dtype), h, weight.to(h.dtype))
            )
        return self.last(h)


class UNet(nn.Module):
    """Features of every cell, from near and far. An embedding modulates every level, if there is
    one."""

    def __init__(
        self, entering: int, widths: Sequence[int], embedding: int | None, attended: int
    ) -> None:
        super().__init__()
        self.enter = nn.Conv2d(entering, widths[0], 3, padding=1)
        self.down, self.up = nn.ModuleList(), nn.ModuleList()
        for level, width in enumerate(widths):
            attends = level >= len(widths) - attended
            above, below = widths[max(level - 1, 0)], widths[min(level + 1, len(widths) - 1)]
            self.down.append(Level((above, width), embedding, attended=attends))
            self.up.append(Level((below + width, width), embedding, attended=attends))
        self.middle = Level((widths[-1], widths[-1]), embedding, attended=attended > 0)
        self.norm = nn.GroupNorm(GROUPS, widths[0])

    def forward(self, cells: Float[Tensor, "b c y x"], embedding: Tensor | None) -> Tensor:
        h, kept = self.enter(cells), []
        for level, block in enumerate(self.down):
            h = block(F.avg_pool2d(h, 2) if level else h, embedding)
            kept.append(h)
        h = self.middle(h, embedding)
        for level, block in reversed(list(enumerate(self.up))):
            h = block(torch.cat((h, kept[level]), 1), embedding)
            h = F.interpolate(h, scale_factor=2.0, mode="nearest") if level else h
        return self.norm(h)


class Level(nn.Module):
    """Two convolutions around what the embedding says, then attention where it is asked for."""

    def __init__(self, widths: Sequence[int], embedding: int | None, *, attended: bool) -> None:
        super().__init__()
        entering, width = widths
        self.before, self.between = nn.GroupNorm(GROUPS, entering), nn.GroupNorm(GROUPS, width)
        self.first = nn.Conv2d(entering, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        self.told = None if embedding is None else nn.Linear(embedding, 2 * width)
        self.beside = nn.Conv2d(entering, width, 1) if entering != width else nn.Identity()
        self.look = Attention(width) if attended else None
        nn.init.zeros_(self.second.weight)

    def forward(self, x: Float[Tensor, "b c y x"], embedding: Tensor | None) -> Tensor:
        h = self.between(self.first(F.silu(self.before(x))))
        if self.told is not None:
            h = _modulated(h, self.told(embedding))
        h = self.beside(x) + self.second(F.silu(h))
        return h if self.look is None else self.look(h)


class Attention(nn.Module):
    """Every cell looks at all cells."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(GROUPS, width)
        self.qkv, self.out = nn.Conv2d(width, 3 * width, 1), nn.Conv2d(width, width, 1)
        nn.init.zeros_(self.out.weight)

    def forward(self, x: Float[Tensor, "b c y x"]) -> Tensor:
        b, c, y, w = x.shape
        qkv = self.qkv(self.norm(x)).reshape(b, 3, c // HEAD, HEAD, y * w)
        q, k, v = qkv.transpose(-1, -2).unbind(1)
        read = F.scaled_dot_product_attention(q, k, v)
        return x + self.out(read.transpose(-1, -2).reshape(b, c, y, w))


def _modulated(h: Float[Tensor, "b c y x"], told: Float[Tensor, "b d"]) -> Tensor:
    """Scaled and shifted, channel by channel; d = 2c."""
    scale, shift = told[:, :, None, None].chunk(2, 1)
    return h * (1 + scale) + shift


def _waves(sigma: Float[Tensor, " b"]) -> Float[Tensor, "b e"]:
    """log sigma at frequencies that tell a hundredth from a hundred. Beyond what is ever taught it
    is as at the last sigma that is."""
    frequencies = torch.exp(torch.linspace(math.log(0.1), math.log(10.0), WAVES)).to(sigma)
    angles = sigma.clamp(*TAUGHT).log()[:, None] * frequencies
    return torch.cat((angles.cos(), angles.sin()), 1)
