"""`painter` as an editor: views are painted in a style, by name or that of a picture; and a sheet
of all styles.

`v` pictures of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch
from PIL import Image

from gsedit.errors import Said, UsageError
from gsedit.formats.pictures import as_picture
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.painter.network import (
    CELL,
    Affine,
    PaintNetwork,
    hold,
    load_picture_styles,
    mixed,
    painted,
    read_style_picture,
    style_of,
    weights_of,
)
from gsedit.paper.protocol import Capabilities, EditBatch, EditProgress
from gsedit.pictures.contact_sheet import captioned
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.picture import render_picture
from gsedit.views.around import score_render
from gsedit.views.dataset import evenly_spaced
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.lexicon import LIKE, styles
from gsedit.words.read import read_instruction
from gsedit.words.refusals import no_style
from gsedit.words.scan import scanned
from rasterizer.scene import Gaussians

WEIGHTS = Path(__file__).with_name("styles.safetensors")
BRUSH = 384
"""Pixels, longer side of the pictures that are painted. Below 256 the network draws no strokes but
a grid of dots."""
BATCHES = 6
"""A view takes 0.05 s, so that more of a scene is painted than another editor would edit."""


@dataclass(frozen=True, eq=False)
class Painter:
    """An Editor: every view is painted in the style that the sentence asks for, or of a picture."""

    network: PaintNetwork
    styles: tuple[tuple[Affine, ...], ...]
    """Affine maps of the layers for each style, by its number."""
    like: str = ""
    """Name of the picture that has the style, which is the only one then; "" for named styles."""
    strength: float = 1.0
    """How far pictures go to the style, from 0 to 1."""
    keep_colors: bool = False
    """Whether only the brightness of pictures is painted."""
    cell: int = CELL
    stroke_batches: int = BATCHES

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UsageError(f"strength {self.strength:g}: give a number from 0 to 1")

    @property
    def name(self) -> str:
        """The painter, and what it paints like: an edit is resumed with the same."""
        details = [f"like {self.like}"] * bool(self.like)
        details += [f"strength {self.strength:g}"] * (self.strength < 1)
        return ", ".join(("painter", *details, *["colors kept"] * self.keep_colors))

    @property
    def capabilities(self) -> Capabilities:
        """It draws at a size of its own."""
        return Capabilities(best_size=BRUSH, enlarges=True)

    def check(self, prompt: str) -> None:
        """Raise UsageError for a sentence that asks for no style."""
        self._style(prompt)

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Paint the originals; none is anchored to another. Raises UsageError as `check`."""
        originals = batch.originals
        change = painted(self.network, originals, self._style(batch.prompt)) - originals
        if self.keep_colors:
            change = (change @ change.new_tensor(LUMINANCE))[..., None]
        yield EditProgress(1, 1, (originals + self.strength * change).clamp(0, 1))

    def _style(self, prompt: str) -> tuple[Affine, ...]:
        """The affine maps that a sentence asks for. Raises UsageError."""
        asked = styles_asked(prompt)
        numbers = [styles()[name] for name in asked if name != LIKE]
        if not self.like and len(numbers) < len(asked):
            raise UsageError(Said(f"{prompt!r} names no picture", "like"))
        if self.like and numbers:
            raise UsageError(Said(f"{asked[0]} is not the style of {self.like}", "unlike"))
        return mixed([self.styles[k] for k in numbers or [0]], [1.0] * max(len(numbers), 1))


def styles_asked(sentence: str) -> tuple[str, ...]:
    """Names of the styles that a sentence asks for, to be mixed; `LIKE` for that of a picture that
    is given beside the sentence.

    Raises UsageError for a sentence that asks for something else, styles of several parts, or is
    refused.
    """
    read = read_instruction(sentence)
    told = [each.rpartition(" in the style of ")[2] for each in sentence.split("; ")]
    denied = any(word.kind in ("not", "drop") for word in scanned(sentence))
    if not read.known and not denied and styles().keys() >= set(told):
        return tuple(told)  # of a part whose name only the scene knows
    if not read.known:
        raise UsageError(f"{sentence.strip()!r}: {read.why}")
    others = [change for change in read.changes if change.route != "style"]
    if others and others[0].route == "pix2pix":
        raise UsageError(no_style(others[0].name))
    if others:
        raise UsageError(
            f"{others[0]}: this is no painting style, and is done without a 2D editor: leave "
            "--editor out"
        )
    if len({change.part for change in read.changes}) > 1:
        raise UsageError(f"{sentence.strip()!r} asks for styles of several parts: say one part")
    return tuple(dict.fromkeys(change.name for change in read.changes))


def make_painter(
    like: Path | None = None, strength: float | None = None, keep_colors: bool | None = None
) -> Painter:
    """The painter of named styles, or of that of the picture `like`; see `Painter`.

    Raises InputError for weights or a picture that cannot be read, UsageError for a picture that is
    too small and for a strength that is out of range.
    """
    made = load_painter()
    if like is not None:
        style = style_of(read_style_picture(like))
        made = replace(made, network=load_picture_styles()[0], styles=(style,), like=like.name)
    return replace(
        made, strength=1.0 if strength is None else strength, keep_colors=bool(keep_colors)
    )


@lru_cache(maxsize=1)
def load_painter(path: Path = WEIGHTS) -> Painter:
    """The painter with the weights that come with gsedit, kept in memory.

    Raises InputError where the file is missing or damaged.
    """
    with weights_of(path) as held:
        gammas = {k.removesuffix(".gamma"): v for k, v in held.items() if k.endswith(".gamma")}
        styles = tuple(
            tuple(Affine(gammas[name][k], held[f"{name}.beta"][k]) for name in gammas)
            for k in range(len(next(iter(gammas.values()))))
        )
        with torch.device("meta"):
            network = PaintNetwork()
        hold(network, {k: v for k, v in held.items() if k.endswith(".weight")})
        return Painter(network, styles)


SHEET_CELL = 256
"""Longer side of a picture, pixels: it is painted at this size."""
COLUMNS = 7
"""Pictures beside each other."""
JUDGED, JUDGED_SIZE = 8, 64
"""Views of which the one is taken that shows most, and the longer side of the renders that tell."""


def style_sheet(scene: Gaussians, viewpoints: Sequence[Viewpoint]) -> Image.Image:
    """One view of a scene, as it is and in every style.

    Raises InputError where the painter's weights are missing or damaged.
    """
    judged = [viewpoints[i].camera for i in evenly_spaced(len(viewpoints), JUDGED)]
    best = max(judged, key=lambda each: score_render(scene, each.fitted(JUDGED_SIZE)).score)
    shown = render_picture(scene, best)
    painter = load_painter()
    cells = [("unedited", shown)]
    for name, number in styles().items():
        cells.append((name, painted(painter.network, shown[None], painter.styles[number])[0]))
    return captioned([(name, as_picture(picture)) for name, picture in cells], COLUMNS)
