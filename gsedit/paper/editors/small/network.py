"""The network of `small`: it encodes the unedited image once, then denoises its edit step by step.

`b` images, `y x` cells of 4x4 pixels, 48 channels: the pixels of a cell, color by color.

It has two U-Nets. The image encoder sees the unedited image alone, so it runs once an edit and
needs no noise level. It is trained to predict the main subject's mask, the inverse depth and the
normal's height of every pixel, since these decide where an edit acts. The denoiser sees the noised
edit, the noise level, the look that is asked for and the encoder's features. Together they predict

  mean = c + g + m s + r               c the unedited pixels, m the probability of the main subject
  x0   = w x_t / a + (1 - w) mean      w = p^2 / (p^2 + sigma^2), p = PRIOR_STD

g, for the whole image, and s, for the subject alone, are colors that a small MLP computes pixel by
pixel from the color and the encoder's pixel features, modulated by the look (FiLM, Perez et al.
2018): most looks are a function of color, place and shape. r is the residual, from the
denoiser. The second line is the posterior mean of a pixel whose prior is N(mean, p^2) (w is c_skip
of Karras et al. 2022): a pixel with hardly any noise is kept, pure noise is ignored, and
v = (a x_t - x0) / b (Salimans and Ho 2022) stays bounded at both ends.
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

from gsedit.views.padding import pad_to_multiple

HEAD_CHANNELS = 32  # of an attention head
GROUPS = 8  # of a group norm
PIXELS_AT_ONCE = 9216  # of the MLP: its layers stay in a core's cache, which halves its time


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
        self,
        pixels: Float[Tensor, "n p"],
        subject: Float[Tensor, " n"],
        embedding: Float[Tensor, " e"],
    ) -> Float[Tensor, "3 n"]:
        """The color to add to each pixel of an image: one everywhere, one on the subject alone."""
        layers: list[tuple[Tensor, Tensor]] = []
        for layer, film in zip((self.first, self.second), self.film):
            scale, shift = film(embedding).chunk(2)
            factor = 1 + scale  # on the weights: the product costs no more
            layers.append((layer.weight * factor[:, None], layer.bias * factor + shift))
        in_place = not torch.is_grad_enabled()
        parts = []
        for h, inside in zip(pixels.split(PIXELS_AT_ONCE), subject.split(PIXELS_AT_ONCE)):
            for weight, bias in layers:
                h = F.silu(F.linear(h, weight, bias), inplace=in_place)
            edit = torch.addmm(self.last.bias[:, None], self.last.weight, h.T).float()
            parts.append(torch.addcmul(edit[:3], inside, edit[3:]))
        return torch.cat(parts, 1)


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
        return self.after_first(self.conv_in(cells), embedding)

    def after_first(
        self, h: Float[Tensor, "b c y x"], embedding: Float[Tensor, "n e"] | None
    ) -> Float[Tensor, "n d y x"]:
        """All that follows the first convolution. `n` is a multiple of `b`: the images are
        repeated for the embeddings, from where these act on them."""
        skips = []
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
        self, x: Float[Tensor, "b c y x"], embedding: Float[Tensor, "n e"] | None
    ) -> Float[Tensor, "n d y x"]:
        """`n` is a multiple of `b`, as in UNet.after_first."""
        h, skipped = self.norm2(self.conv1(F.silu(self.norm1(x)))), self.skip(x)
        if self.film is not None and embedding is not None:
            h = modulated(h, self.film(embedding))
            skipped = repeated(skipped, len(embedding))
        h = skipped + self.conv2(F.silu(h))
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


def modulated(h: Float[Tensor, "b c y x"], film: Float[Tensor, "n d"]) -> Float[Tensor, "n c y x"]:
    """Scaled by 1 + the first half of `film`, shifted by the second, per channel; d = 2c. Images
    are repeated for as many modulations as there are of each."""
    scale, shift = film.unflatten(0, (-1, len(h)))[..., None, None].chunk(2, 2)
    return (h * (1 + scale) + shift).flatten(0, 1)


def repeated(x: Float[Tensor, "b ..."], rows: int) -> Float[Tensor, "n ..."]:
    """The tensor itself where it has so many rows, else its rows again and again."""
    return x if len(x) == rows else x.repeat(rows // len(x), *(1 for _ in x.shape[1:]))


CELL_PIXELS = 4
CHANNELS = 3 * CELL_PIXELS * CELL_PIXELS
PRIOR_STD = 0.15  # of values in [-1, 1]: about the error of the network's mean where it is unsure
TRAINED_SIGMAS = (0.02, 360.0)  # the range of sigma of its training
INPUT_NOISE_SCALE = 4.0  # the denoiser's input x_t is divided by 1 + sigma / INPUT_NOISE_SCALE
GEOMETRY_CHANNELS = 3  # of every pixel: subject, depth, height of the normal
FREQUENCIES = 16  # of the noise level's embedding


class EncodedImage(NamedTuple):
    """Features of unedited images, from the image encoder."""

    features: Float[Tensor, "b c y x"]
    """Per cell; an input of the denoiser."""
    pixels: Float[Tensor, "b p h w"]
    """Features per pixel: first the three of `geometry`, then some without a meaning of their
    own."""

    @property
    def geometry(self) -> Float[Tensor, "b 3 h w"]:
        """Log odds of the main subject; 1 / depth, in distances of the subject; height of the unit
        normal."""
        return self.pixels[:, :GEOMETRY_CHANNELS]


class PreparedImage(NamedTuple):
    """Parts of the denoiser's work on unedited images that all steps share."""

    image: Float[Tensor, "b 48 y x"]
    """0 where the image is dropped."""
    entering: Float[Tensor, "b c Y X"]
    """Share of images and features in the first convolution."""
    pixels: Float[Tensor, "b n p"]
    """Colors and features of every pixel."""
    subject: Float[Tensor, "b n"]
    """The probability that a pixel shows the main subject."""


@dataclass(frozen=True)
class Architecture:
    """Sizes of the network; kept in the weights' metadata."""

    image_encoder: tuple[int, ...] = (64, 96, 160, 192)
    """Channels per level of this U-Net; each level halves the sides of the one before."""
    denoiser: tuple[int, ...] = (48, 64, 96)
    attention_levels: int = 2
    """How many of the image encoder's lowest levels have self-attention."""
    pixel_features: int = 12
    """Number of channels of `EncodedImage.pixels`."""
    pixel_mlp: int = 32
    """Width of the MLP's hidden layers."""
    embedding: int = 256
    """Channels of the joint embedding of look and noise level."""
    text_width: int = 128
    """Channels of a look's vector."""
    looks: int = 51
    """Number of looks, each with a vector; there is one more, of no look."""

    @property
    def multiple(self) -> int:
        """Cells: sides are padded to multiples of it inside."""
        return 2 ** (max(len(self.image_encoder), len(self.denoiser)) - 1)


def to_cells(images: Float[Tensor, "b h w 3"]) -> Float[Tensor, "b 48 y x"]:
    """Images with values in [0, 1] as cells in [-1, 1], whose 4x4 pixels are channels."""
    return F.pixel_unshuffle((2 * images - 1).movedim(-1, 1), CELL_PIXELS)


def from_cells(cells: Float[Tensor, "b 48 y x"]) -> Float[Tensor, "b h w 3"]:
    """The exact inverse of to_cells."""
    return F.pixel_shuffle(cells, CELL_PIXELS).movedim(1, -1) / 2 + 0.5


class SmallNetwork(nn.Module):
    """Image encoder, vectors of looks and denoiser; see the module's docstring."""

    def __init__(self, architecture: Architecture | None = None) -> None:
        super().__init__()
        self.architecture = a = architecture or Architecture()
        self.looks = nn.Embedding(a.looks + 1, a.text_width)
        self.image_encoder = UNet(CHANNELS + 1, a.image_encoder, None, a.attention_levels)
        self.pixel_head = nn.Conv2d(
            a.image_encoder[0], a.pixel_features * CELL_PIXELS * CELL_PIXELS, 3, padding=1
        )
        self.text_embedding = nn.Linear(a.text_width, a.embedding)
        self.noise_embedding = nn.Sequential(
            nn.Linear(2 * FREQUENCIES, a.embedding),
            nn.SiLU(),
            nn.Linear(a.embedding, a.embedding),
        )
        self.denoiser = UNet(2 * CHANNELS + a.image_encoder[0], a.denoiser, a.embedding, 0)
        self.residual_head = nn.Conv2d(a.denoiser[0], CHANNELS, 3, padding=1)
        self.global_embedding = nn.Linear(a.denoiser[0], a.embedding)
        self.pixel_mlp = PixelMLP(3 + a.pixel_features, a.pixel_mlp, a.embedding)
        for parameter in self.residual_head.parameters():
            nn.init.zeros_(parameter)

    def encode_image(
        self, image: Float[Tensor, "b 48 y x"], image_mask: Float[Tensor, " b"]
    ) -> EncodedImage:
        """Encode unedited images. Where `image_mask` is 0 the image is dropped, as in training for
        classifier-free guidance: the result does not depend on it."""
        y, x = image.shape[-2:]
        mask = image_mask[:, None, None, None]
        masked = torch.cat((image * mask, mask.expand(-1, 1, y, x)), 1)
        features = self.image_encoder(self._padded(masked), None)[..., :y, :x]
        pixels = self.pixel_head(F.silu(features))
        return EncodedImage(features, F.pixel_shuffle(pixels, CELL_PIXELS))

    def prepare(
        self,
        image: Float[Tensor, "b 48 y x"],
        image_mask: Float[Tensor, " b"],
        encoded: EncodedImage,
    ) -> PreparedImage:
        """Compute once what every step of the denoiser needs of the unedited images."""
        image = image * image_mask[:, None, None, None]
        inputs = self._padded(torch.cat((image, encoded.features.to(image.dtype)), 1))
        first = self.denoiser.conv_in
        entering = F.conv2d(inputs, first.weight[:, CHANNELS:], first.bias, padding=1)
        colors = F.pixel_shuffle(image, CELL_PIXELS).to(encoded.pixels.dtype)
        pixels = torch.cat((colors, encoded.pixels), 1).flatten(2).transpose(1, 2).contiguous()
        subject = encoded.geometry[:, 0].sigmoid().flatten(1)
        return PreparedImage(image, entering, pixels, subject)

    def denoise(
        self,
        x: Float[Tensor, "b 48 y x"],
        sigma: Float[Tensor, " b"],
        prepared: PreparedImage,
        text: Float[Tensor, "n d"],
    ) -> Float[Tensor, "n 48 y x"]:
        """x0 of x = x_t, which has unit power where it is all noise (a^2 + b^2 = 1; sigma = b / a).

        `text` are rows of `looks`; `n` is a multiple of `b`: those of all images under one look
        come before those under the next.
        """
        y, w = x.shape[-2:]
        level = sigma[:, None, None, None]
        scaled = self._padded(x / (1 + level / INPUT_NOISE_SCALE))
        noise = self.noise_embedding(_noise_frequencies(sigma))
        embedding = F.silu(self.text_embedding(text) + repeated(noise, len(text)))
        h = F.conv2d(scaled, self.denoiser.conv_in.weight[:, :CHANNELS], padding=1)
        h = self.denoiser.after_first(h + prepared.entering.to(h.dtype), embedding)
        h = F.silu(h[..., :y, :w])
        residual = self.residual_head(h).to(x.dtype)
        embedding = embedding + F.silu(self.global_embedding(h.mean((2, 3))))
        edit = self._pixel_edit(prepared, embedding, w).to(x.dtype) + residual
        c_skip = PRIOR_STD**2 / (PRIOR_STD**2 + level**2)
        clean = x * (1 + level**2).sqrt()  # x_t / a
        kept = c_skip * clean + (1 - c_skip) * prepared.image
        return (kept + (1 - c_skip) * edit.unflatten(0, (-1, len(x)))).flatten(0, 1)

    def _pixel_edit(
        self, prepared: PreparedImage, embedding: Float[Tensor, "n e"], columns: int
    ) -> Float[Tensor, "n 48 y x"]:
        """g + m s, for images of that many columns of cells."""
        images = len(prepared.pixels)
        edits = [
            self.pixel_mlp(prepared.pixels[i % images], prepared.subject[i % images], each)
            for i, each in enumerate(embedding)
        ]
        edit = torch.stack(edits).unflatten(2, (-1, CELL_PIXELS * columns))
        return F.pixel_unshuffle(edit, CELL_PIXELS)

    def _padded(self, cells: Float[Tensor, "b c y x"]) -> Float[Tensor, "b c Y X"]:
        """Continued right and below to sides that every level can halve."""
        return pad_to_multiple(cells, self.architecture.multiple, "edge", axis=2)


def _noise_frequencies(sigma: Float[Tensor, " b"]) -> Float[Tensor, "b f"]:
    """Cosines and sines of log sigma, at frequencies that tell sigmas of 0.01 from 100 and 1 from
    1.1; outside of the trained range they are those of its nearer end."""
    frequencies = torch.exp(torch.linspace(math.log(0.1), math.log(10.0), FREQUENCIES)).to(sigma)
    angles = sigma.clamp(*TRAINED_SIGMAS).log()[:, None] * frequencies
    return torch.cat((angles.cos(), angles.sin()), 1)
