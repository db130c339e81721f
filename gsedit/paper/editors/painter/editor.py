"""`painter` as an editor: views are painted in a style, by name or that of a picture, or drawn in
pencil; and a sheet of all styles.

`v` pictures of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

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
from gsedit.paper.editors.protocol import Capabilities, EditBatch, EditProgress
from gsedit.pictures.contact_sheet import captioned
from gsedit.scene.color_space import LUMINANCE
from gsedit.views.around import score_render
from gsedit.views.dataset import evenly_spaced
from gsedit.views.noise import noise
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


SKETCH = "sketch"
"""Name of the style that is drawn, over what the others paint."""
PAPER, GRAPHITE = 0.97, 0.12
"""Display tones of paper and of lines."""
LINES, EDGE, JUMP = (1.2, 2.4), 0.05, 0.06
"""Widths of lines, pixels; differences in tone, and in the logarithm of depth, of the darkest."""
GRAIN, BUSY = 0.08, 0.03
"""Length of a line, in the picture's longer side, that is about the least that is no grain;
difference in tone from the surroundings from which there are too many."""
HATCHES = ((40.0, 0.65), (40.0, 0.39), (-30.0, 0.21))
"""Directions of hatching, degrees, and the tones below which each begins."""
STROKE = (30.0, 2.6)
"""Length and width of its strokes, pixels: Gaussians hold no finer ones."""
Map = NDArray[np.float64]


def penciled(
    picture: Float[Tensor, "h w 3"], depth: Float[Tensor, "h w"] | None = None
) -> Float[Tensor, "h w 3"]:
    """The picture in pencil: lines on the dark side of edges and the near side of jumps in depth,
    and hatching by tone, paler where it is far."""
    from scipy.ndimage import gaussian_filter, median_filter

    luma = picture.double().numpy() @ (LUMINANCE / LUMINANCE.sum())
    low, high = np.quantile(luma, (0.02, 0.9))
    tone = np.clip((luma - low) / max(high - low, 1e-3), 0, 1)
    even, pale = _even(tone, 2), 1.0
    busy = gaussian_filter(np.abs(gaussian_filter(even, 1.6) - even), 8) / BUSY
    edges = (gaussian_filter(even, 1.6 * size) - gaussian_filter(even, size) for size in LINES)
    line = np.max([_long(each / (EDGE * busy.clip(1))) for each in edges], 0)
    if depth is not None:
        seen = torch.where(depth > 0, depth, depth.max()).double().clamp_min(1e-6)
        far = median_filter(seen.log().numpy(), 5)
        line = np.maximum(line, _long((gaussian_filter(far, 2) - far) / JUMP))
        pale = np.exp(2 * (np.quantile(far, 0.3) - far) + 0.5).clip(0.25, 1)
    calm = tone + (busy - 0.7).clip(0, 1) * (gaussian_filter(even, 12) - tone)
    left = (1 - line * np.sqrt(pale)) * (1 - pale * _hatching(calm))
    drawn = torch.from_numpy(GRAPHITE + (PAPER - GRAPHITE) * left).to(picture)
    return drawn[..., None].repeat(1, 1, 3)


def _even(tone: Map, radius: int) -> Map:
    """The tone without grain: the guided filter of gsedit.paper.guided, by itself."""
    from scipy.ndimage import uniform_filter

    mean = partial(uniform_filter, size=2 * radius + 1)
    slope = 1 - 0.01 / (0.01 + mean(tone * tone) - mean(tone) ** 2)
    return mean(slope) * tone + mean((1 - slope) * mean(tone))


def _long(edge: Map) -> Map:
    """Edges as lines, in [0, 1], but for short ones."""
    from scipy.ndimage import find_objects, label

    line = edge.clip(0, 1)
    found: Any = label(line > 0.3, np.ones((3, 3)))
    parts = found[0]
    sides = [np.hypot(*(each.stop - each.start for each in box)) for box in find_objects(parts)]
    length = np.array([0.0, *sides]) / (GRAIN * max(edge.shape))
    return line * (length[parts] - 0.4).clip(0, 1)


def _hatching(tone: Map) -> Map:
    """Strokes, the more and in more directions the darker it is, also against what is around."""
    from scipy.ndimage import gaussian_filter

    soft = _even(_even(gaussian_filter(tone, 1.5), 4), 4)
    beside = soft - gaussian_filter(soft, 40)
    beside = beside / (np.sqrt(gaussian_filter(beside**2, 40)) + 0.06)
    soft = 0.4 * soft + 0.6 * (0.62 + 0.3 * beside).clip(0, 1)
    y, x = np.indices(tone.shape)
    left = np.ones_like(tone)
    for number, (angle, begins) in enumerate(HATCHES):
        turn = np.exp(1j * np.radians(angle)) * (x + 1j * y)
        at = np.stack((turn.real / STROKE[0], turn.imag / STROKE[1], 0 * turn.real), -1)
        grain = noise(torch.from_numpy(at).reshape(-1, 3), number).reshape(tone.shape).numpy()
        share = ((begins - soft) / 0.35).clip(0, 1) * (0.42 * (1 + grain)).clip(0, 1)
        left *= 1 - 0.7 * share
    return 1 - left


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
    draws: bool = False
    """Whether it is drawn then, which `in_styles` tells."""
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
        if not (self.asked or self.draws):
            raise UsageError(f"{prompt!r}: the painter reads no words, tell it by `in_styles`")

    def in_styles(self, names: tuple[str, ...]) -> Painter:
        """The painter of these styles, mixed; `LIKE` is that of the picture. Raises UsageError for
        a picture that there is none of, and for others where there is one."""
        named = [name for name in names if name != LIKE]
        if not self.like and len(named) < len(names):
            raise UsageError(Said("no picture is given", "like"))
        if self.like and named:
            raise UsageError(Said(f"{named[0]} is not the style of {self.like}", "unlike"))
        maps = [self.styles[styles()[name]] for name in named if name != SKETCH]
        maps = maps if SKETCH in named else maps or [self.styles[0]]
        asked = mixed(maps, [1.0] * len(maps)) if maps else ()
        return replace(self, asked=asked, draws=SKETCH in named)

    def pictures(
        self, originals: Float[Tensor, "v h w 3"], depths: Float[Tensor, "v h w"] | None = None
    ) -> Float[Tensor, "v h w 3"]:
        """Pictures in the styles that are asked for, at full strength."""
        made = painted(self.network, originals, self.asked) if self.asked else originals
        known = repeat(None) if depths is None else depths
        return torch.stack([penciled(*each) for each in zip(made, known)]) if self.draws else made

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Paint the originals; none is anchored to another. Raises UsageError as `check`."""
        self.check(batch.prompt)
        originals = batch.originals
        change = self.pictures(originals, batch.depths) - originals
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
