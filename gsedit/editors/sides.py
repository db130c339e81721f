"""Pictures brought to the sides a network wants, and back, without moving a pixel.

A picture is continued to the right and below by its own mirror image and cropped afterwards. It is
never resized: a resized picture belongs to another camera, its cells no longer lie where the
correspondences were matched, and going back blurs it twice. Only the right and lower border is
continued, so that cell (i, j) holds the same pixels as before. A mirror image is no streak (as a
repeated edge is) and no frame (as black is) that the network would take for part of the picture.

A whole multiple matters inside the network too: a UNet that halves an odd side meets its own skip
connections only after stretching them, which shifts features by parts of a cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion import SamplerSettings, Suits, suits
from gsedit.editors.protocol import EditBatch, Editor, EditProgress, advice_of


def extend(images: Float[Tensor, "v h w c"], multiple: int) -> Float[Tensor, "v H W c"]:
    """The pictures, mirrored beyond their right and lower edge to sides that `multiple` divides."""
    rows, columns = (_mirror(side, side + -side % multiple) for side in images.shape[1:3])
    return images[:, rows][:, :, columns]


def _mirror(side: int, wanted: int) -> Tensor:
    """0 1 ... side-1 side-1 ... 1 0 0 1 ...: as often as it takes, also for one pixel."""
    index = torch.arange(wanted) % (2 * side)
    return torch.minimum(index, 2 * side - 1 - index)


@dataclass(frozen=True, eq=False)
class WholeSides:
    """An Editor whose inner one only sees pictures with sides that `multiple` divides."""

    inner: Editor
    multiple: int
    """Pixels; a multiple of the inner editor's cell."""

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def cell(self) -> int:
        return self.inner.cell

    @property
    def suits(self) -> Suits:
        """What suits the inner editor."""
        return suits(self.inner)

    def check(self, prompt: str) -> None:
        """Raise UsageError if the inner editor cannot follow the instruction."""
        self.inner.check(prompt)

    def advise(self, prompt: str) -> str:
        """What the inner editor has to say about the instruction."""
        return advice_of(self.inner, prompt)

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """As the inner editor does; cells that are added correspond to nothing."""
        height, width = batch.images.shape[1:3]
        inside = replace(
            batch,
            images=extend(batch.images, self.multiple),
            originals=extend(batch.originals, self.multiple),
        )
        found = batch.correspondences
        if found is not None:
            rows, columns = (side // self.cell for side in inside.images.shape[1:3])
            right, below = columns - found.labels.shape[2], rows - found.labels.shape[1]
            labels = F.pad(found.labels, (0, max(right, 0), 0, max(below, 0)), value=-1)
            inside = replace(inside, correspondences=replace(found, labels=labels))
        for progress in self.inner.edit(inside, settings, generator):
            if progress.images is None:
                yield progress
            else:
                cropped = progress.images[:, :height, :width].contiguous()
                yield replace(progress, images=cropped)
