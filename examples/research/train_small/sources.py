"""Pictures with depth, normals and the subject's mask: as floats, and packed as bytes.

`n` pictures of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float16, Int, Int8, UInt8
from torch import Tensor

Pictures: TypeAlias = Float[Tensor, "n h w 3"]
Shares: TypeAlias = Float[Tensor, "n h w 1"]
"""One value in [0, 1] per pixel."""
FAR = 8.0  # distances of the subject: the depth of the sky and of whatever lies beyond


class Sources(NamedTuple):
    """Pictures to be edited, with the geometry of their scenes."""

    image: Float[Tensor, "n h w 3"]
    """sRGB in [0, 1], float32."""
    depth: Float[Tensor, "n h w 1"]
    """Along the view, in distances of the subject (it is at about 1); at most FAR, as the sky."""
    normal: Float[Tensor, "n h w 3"]
    """Unit, in a world with +z up, toward the camera; 0 where there is nothing (sky)."""
    subject: Float[Tensor, "n h w 1"]
    """The share of the pixel that is the main subject, in [0, 1]."""

    def rows(self, index: Int[Tensor, " m"]) -> Sources:
        """The pictures of these numbers, in this order."""
        return Sources(*(field[index] for field in self))

    def resampled(
        self, change: Callable[[Float[Tensor, "n c h w"]], Float[Tensor, "n c y x"]]
    ) -> Sources:
        """All fields, as planes [n c h w], resampled by one function; normals are unit again."""
        planes = change(torch.cat(self, -1).movedim(-1, 1))
        image, depth, normal, subject = planes.movedim(1, -1).split((3, 1, 3, 1), -1)
        return Sources(image, depth, F.normalize(normal, dim=-1), subject)


def cat(parts: Sequence[Sources]) -> Sources:
    """All pictures of all parts, one after another."""
    return Sources(*(torch.cat(columns) for columns in zip(*parts)))


@dataclass(frozen=True, eq=False)
class PackedSources:
    """Sources in 9 bytes a pixel: steps of 1/255 in color and mask, 1/127 in normals, 11 bits of
    precision in depth."""

    image: UInt8[Tensor, "n h w 3"]
    depth: Float16[Tensor, "n h w 1"]
    normal: Int8[Tensor, "n h w 3"]
    subject: UInt8[Tensor, "n h w 1"]

    def __len__(self) -> int:
        return len(self.image)

    def __getitem__(self, index: Int[Tensor, " m"]) -> Sources:
        """The pictures of these numbers, as floats."""
        return Sources(
            image=self.image[index].float() / 255,
            depth=self.depth[index].float(),
            normal=F.normalize(self.normal[index].float(), dim=-1),
            subject=self.subject[index].float() / 255,
        )

    def first(self, count: int | None) -> PackedSources:
        """The first pictures, or all (None); not copied."""
        return PackedSources(*(column[:count] for column in vars(self).values()))

    def halved(self) -> PackedSources:
        """Half as high and wide, the mean of 2x2 pixels."""
        parts = (self[rows] for rows in torch.arange(len(self)).split(64))
        return cat_packed(
            [pack(part.resampled(lambda planes: F.avg_pool2d(planes, 2))) for part in parts]
        )


def pack(sources: Sources) -> PackedSources:
    """The pictures as bytes."""
    return PackedSources(
        image=_to_byte(sources.image),
        depth=sources.depth.half(),
        normal=(sources.normal * 127).round().to(torch.int8),
        subject=_to_byte(sources.subject),
    )


def cat_packed(parts: Sequence[PackedSources]) -> PackedSources:
    """All pictures of all parts, one after another, still as bytes."""
    return PackedSources(
        *(torch.cat(column) for column in zip(*(vars(part).values() for part in parts)))
    )


def _to_byte(share: Float[Tensor, "*b"]) -> UInt8[Tensor, "*b"]:
    return (share.clamp(0, 1) * 255).round().to(torch.uint8)
