"""`painter` as an editor: views are painted in a style."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.painter.network import CELL, Affine, Moments, PaintNetwork
from gsedit.paper.protocol import Capabilities, EditBatch, EditProgress
from gsedit.views.padding import pad_to_multiple
from gsedit.words.styles import style_asked

WEIGHTS = Path(__file__).with_name("styles.safetensors")


BRUSH = 192
"""Pixels, longer side of the pictures that are painted. At 256 strokes are finer than the Gaussians
of a scene fitted at 256 pixels can hold (docs/measurements/paper.md)."""
BATCHES = 6
"""A view takes 0.05 s, so that more of a scene is painted than another editor would edit."""
MOST_SURVEYED_PIXELS = 3_000_000
"""Pixels of all pictures that statistics are taken from, evenly spaced ones of more: the widest
layer holds 32 numbers a pixel."""


@dataclass(frozen=True, eq=False)
class Painter:
    """An Editor: every view is painted in the style that the sentence asks for.

    The channels of every layer are normalised by the statistics of all planned views together
    (`with_views`), so that colors do not jump from view to view; without, by the picture's own.
    """

    network: PaintNetwork
    styles: tuple[tuple[Affine, ...], ...]
    """Of each style, by its number, the affine map of every layer."""
    moments: tuple[Moments, ...] | None = None
    blocks: int = 0
    """Residual blocks after which views agree where they show the same place: it plays the part of
    t_end, and blurs strokes the more, the later it ends."""
    name: str = "painter"
    cell: int = CELL

    @property
    def capabilities(self) -> Capabilities:
        """It draws, at a size of its own, and takes statistics from all planned views."""
        return Capabilities(
            best_size=BRUSH,
            enlarges=True,
            batches=BATCHES,
            draws=True,
            matches=self.blocks > 0,
            with_views=self.with_views,
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError for a sentence that asks for no style."""
        style_asked(prompt)

    @torch.no_grad()
    def with_views(self, prompt: str, pictures: Float[Tensor, "v h w 3"]) -> Painter:
        """This editor with the statistics of these pictures, kept for every later view."""
        step = 1 + len(pictures) * pictures[0, :, :, 0].numel() // MOST_SURVEYED_PIXELS
        _, moments = self.network(_padded(pictures[::step]), self._style(prompt))
        return replace(self, moments=tuple(moments))

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Paint the originals; anchored views stay as they are. Raises UsageError as `check`."""
        style = self._style(batch.prompt)
        height, width = batch.originals.shape[1:3]

        def agree(block: int, x: Tensor) -> Tensor:
            return batch.agreed(x, settings.consensus_weight) if block <= self.blocks else x

        pooled = self.moments is not None
        images, _ = self.network(_padded(batch.originals), style, self.moments, pooled, agree)
        painted = images.movedim(1, -1)[:, :height, :width]
        if batch.anchored is not None:
            painted = torch.where(batch.anchored[:, None, None, None], batch.images, painted)
        yield EditProgress(1, 1, painted)

    def _style(self, prompt: str) -> tuple[Affine, ...]:
        return self.styles[style_asked(prompt).number]


def _padded(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v 3 H W"]:
    return pad_to_multiple(pictures, CELL, "mirror").movedim(-1, 1)


@lru_cache(maxsize=1)
def load_painter(path: Path = WEIGHTS) -> Painter:
    """The painter with the weights that come with gsedit, kept in memory.

    Raises InputError where the file is missing or damaged.
    """
    from safetensors.torch import load_file

    try:
        held = load_file(path)
        gammas = {k.removesuffix(".gamma"): v for k, v in held.items() if k.endswith(".gamma")}
        styles = tuple(
            tuple(Affine(gammas[name][k], held[f"{name}.beta"][k]) for name in gammas)
            for k in range(len(next(iter(gammas.values()))))
        )
        network = PaintNetwork(blocks=6)
        network.load_state_dict({k: v for k, v in held.items() if k.endswith(".weight")})
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(f"{path} does not hold the painter's weights ({reason})") from error
    return Painter(network.eval().requires_grad_(False), styles)
