"""`painter` as an editor: views are painted in a style, by name or that of a picture, or drawn by
rules; and a sheet of all styles.

`v` pictures of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsedit.errors import Said, UsageError
from gsedit.formats.pictures import as_picture
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.painter.drawn import DRAWN, drawn
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
from gsedit.paper.editors.protocol import Capabilities, EditBatch, EditProgress, Places
from gsedit.pictures.contact_sheet import captioned
from gsedit.scene.color_space import LUMINANCE
from gsedit.views.around import score_render
from gsedit.views.dataset import evenly_spaced
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.lexicon import LIKE, styles
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

WEIGHTS = Path(__file__).with_name("styles.safetensors")
BRUSH = 384
"""Pixels, longer side of the pictures that are painted. Below 256 the network draws no strokes but
a grid of dots."""
BATCHES = 6
"""A view takes 0.05 s, so that more of a scene is painted than another editor would edit."""


@dataclass(frozen=True, eq=False)
class Painter:
    """An Editor: every view is painted in the styles asked for, or in that of a picture."""

    network: PaintNetwork
    styles: tuple[tuple[Affine, ...], ...]
    """Affine maps of the layers for each style, by its number."""
    like: str = ""
    """Name of the picture that has the style, which is the only one then; "" for named styles."""
    strength: float = 1.0
    """How far pictures go to the style, from 0 to 1."""
    keep_colors: bool = False
    """Whether only the brightness of pictures is painted."""
    asked: tuple[Affine, ...] = ()
    """Affine maps of what is painted, which `in_styles` gives."""
    rules: tuple[str, ...] = ()
    """Styles of `DRAWN` that it is drawn in then, which `in_styles` gives too."""
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
        """Raise UsageError where no style was given: it reads no prompt."""
        if not (self.asked or self.rules):
            raise UsageError(f"{prompt!r}: the painter reads no words, tell it by `in_styles`")

    def in_styles(self, names: tuple[str, ...]) -> Painter:
        """The painter of these styles, mixed; `LIKE` is that of the picture. Raises UsageError for
        a picture that there is none of, and for others where there is one."""
        named = [name for name in names if name != LIKE]
        if not self.like and len(named) < len(names):
            raise UsageError(Said("no picture is given", "like"))
        if self.like and named:
            raise UsageError(Said(f"{named[0]} is not the style of {self.like}", "unlike"))
        rules = tuple(name for name in named if name in DRAWN)
        maps = [self.styles[styles()[name]] for name in named if name not in rules]
        maps = maps or [self.styles[0]] * (not rules)
        asked = mixed(maps, [1.0] * len(maps)) if maps else ()
        return replace(self, asked=asked, rules=rules)

    def pictures(
        self, originals: Float[Tensor, "v h w 3"], places: Places | None = None
    ) -> Float[Tensor, "v h w 3"]:
        """Pictures in the styles that are asked for, at full strength."""
        made = [painted(self.network, originals, self.asked)] if self.asked else []
        return torch.stack([*made, *(drawn(each, originals, places) for each in self.rules)]).mean(
            0
        )

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Paint the originals; none is anchored to another. Raises UsageError as `check`."""
        self.check(batch.prompt)
        originals = batch.originals
        change = self.pictures(originals, batch.places) - originals
        if self.keep_colors:
            change = (change @ change.new_tensor(LUMINANCE))[..., None]
        yield EditProgress(1, 1, (originals + self.strength * change).clamp(0, 1))


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
    with weights_of(path) as held, torch.random.fork_rng(devices=()):
        gammas = {k.removesuffix(".gamma"): v for k, v in held.items() if k.endswith(".gamma")}
        styles = tuple(
            tuple(Affine(gammas[name][k], held[f"{name}.beta"][k]) for name in gammas)
            for k in range(len(next(iter(gammas.values()))))
        )
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
    for name in styles():
        cells.append((name, painter.in_styles((name,)).pictures(shown[None])[0]))
    return captioned([(name, as_picture(picture)) for name, picture in cells], COLUMNS)
