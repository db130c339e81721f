"""`painter` as an editor: views are painted in a style."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import InputError, Said, UsageError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.painter.network import CELL, Affine, PaintNetwork
from gsedit.paper.protocol import Capabilities, EditBatch, EditProgress
from gsedit.views.padding import pad_to_multiple
from gsedit.words.styles import style_asked

WEIGHTS = Path(__file__).with_name("styles.safetensors")


@dataclass(frozen=True, eq=False)
class Painter:
    """An Editor: every view is painted in the style that the sentence asks for."""

    network: PaintNetwork
    styles: tuple[tuple[Affine, ...], ...]
    """Of each style, by its number, the affine map of every layer."""
    name: str = "painter"
    cell: int = CELL

    @property
    def capabilities(self) -> Capabilities:
        """Only that it paints styles."""
        return Capabilities(paints_styles=True)

    def check(self, prompt: str) -> None:
        """Raise UsageError for a sentence that asks for no style of the network."""
        self._number(prompt)

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Paint the originals; anchored views stay as they are. Raises UsageError as `check`."""
        style = self.styles[self._number(batch.prompt)]
        height, width = batch.originals.shape[1:3]
        images, _ = self.network(_padded(batch.originals), style)
        painted = images.movedim(1, -1)[:, :height, :width]
        if batch.anchored is not None:
            painted = torch.where(batch.anchored[:, None, None, None], batch.images, painted)
        yield EditProgress(1, 1, painted)

    def _number(self, prompt: str) -> int:
        style = style_asked(prompt)
        if style.number is None:
            raise UsageError(Said(f"{prompt!r} names no picture", "like"))
        return style.number


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
