"""Styles that are drawn by rules. Panes, dabs, cuts and the grain of charcoal have their places in
space, so that views agree on them; hatching has not. Sizes are in pixels at the mean distance.

A picture of `h w` pixels is float64 in [0, 1] here; a map is one number a pixel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.ndimage import find_objects, gaussian_filter, label, uniform_filter
from scipy.spatial import KDTree
from scipy.special import expit
from torch import Tensor

from gsedit.paper.editors.protocol import Places
from gsedit.scene.color_space import LUMINANCE
from gsedit.views.noise import noise

Map = NDArray[np.float64]
PAPER, GRAPHITE = 0.97, 0.12
"""Display tones of paper and of lines in pencil."""
PRINTED, INK = np.array([0.94, 0.89, 0.78]), np.array([0.08, 0.06, 0.05])
"""Colors of a print's paper and of its ink."""
LINES, EDGE, JUMP = (1.2, 2.4), 0.05, 0.06
"""Widths of lines, pixels; differences in tone, and in the logarithm of depth, of the darkest."""
WIDE = 1.7
"""Times as wide that ink, cut lines and charcoal are."""
GRAIN, BUSY = 0.08, 0.03
"""Length of a line, in the picture's longer side, that is about the least that is no grain;
difference in tone from the surroundings from which there are too many."""
HATCHES = ((40.0, 0.65), (40.0, 0.39), (-30.0, 0.21))
"""Directions of hatching, degrees, and the tones below which each begins."""
STROKE = (30.0, 2.6)
"""Length and width of its strokes, pixels: Gaussians hold no finer ones."""
TONES, VIVID = 4, 1.8
"""Tones of flat color, and how much its saturation is raised."""
NEAR = np.indices((3, 3, 3)).reshape(3, 27).T - 1.0
"""A cell of the grid and those around it."""
SHAKEN = np.array(
    [[12.9898, 39.3468, 73.1562], [78.2331, 11.1353, 52.2355], [37.7193, 83.1551, 9.1517]]
)
"""Directions without a common period."""
CUT, ASIDE, BEND = 10.0, 0.8, 3.0
"""Distance between cut lines, pixels; how far they run aside rather than level; lines by which they
bend from dark to bright."""
PANE, DAB = 22.0, 8.0
"""Size of a pane of glass and of a dab of paint, pixels."""
BLUE = np.array([0.07, 0.22, 0.52])
"""Color of a plan's paper."""
LEAD = 0.07
"""Half the width of the lead, in panes."""
TINT = 0.15
"""How much the colors of panes differ."""
KEPT = 0.35
"""Share of what differs in color within a pane that stays."""


class Sight(NamedTuple):
    """A view with the places of its pixels."""

    picture: Map
    """Colors, stretched to the scene's tones."""
    points: Map
    """Places of pixels, see `Places`."""
    up: Map
    far: Map | None
    """Logarithm of the depth."""


def drawn(
    style: str, pictures: Float[Tensor, "v h w 3"], places: Places | None = None
) -> Float[Tensor, "v h w 3"]:
    """The pictures drawn in this style of `DRAWN`, in [0, 1]."""
    made = [DRAWN[style](_sight(each, places, k)) for k, each in enumerate(pictures)]
    return torch.from_numpy(np.stack(made).clip(0, 1)).to(pictures)


def _sight(picture: Float[Tensor, "h w 3"], places: Places | None, k: int) -> Sight:
    """The k-th of the views; where nothing is known, the picture is a plane."""
    values = picture.double().numpy()
    if places is None:
        low, high = np.quantile(values @ LUMINANCE, (0.02, 0.97))
        points, up, far = np.zeros_like(values), np.array([0.0, -1.0, 0.0]), None
        points[..., 1], points[..., 0] = np.indices(values.shape[:2])
    else:
        low, high = places.tones
        points, up = places.points[k].double().numpy(), places.up.double().numpy()
        far = places.depths[k].double().log().numpy()
    return Sight(((values - low) / max(high - low, 1e-3)).clip(0, 1), points, up, far)


def penciled(sight: Sight) -> Map:
    """Lines, and hatching by tone, paler where it is far."""
    tone, pale = sight.picture @ LUMINANCE, 1.0
    if sight.far is not None:
        pale = np.exp(2 * (np.quantile(sight.far, 0.3) - sight.far) + 0.5).clip(0.25, 1)
    even = _even(tone, 2)
    calm = tone + (_busy(even) - 0.7).clip(0, 1) * (gaussian_filter(even, 12) - tone)
    left = (1 - _lines(tone, sight.far) * np.sqrt(pale)) * (1 - pale * _hatching(calm))
    return (GRAPHITE + (PAPER - GRAPHITE) * left)[..., None].repeat(3, -1)


def inked(sight: Sight) -> Map:
    """Few tones of flat, vivid color, and lines in ink."""
    flat = _calm(sight.picture, 4, 4)
    tone = flat @ LUMINANCE
    whole = np.floor(tone * TONES)
    step = (whole + expit((tone * TONES - whole - 0.5) / 0.06)) / TONES
    scale = ((0.12 + 0.88 * step) / (tone + 1e-3)).clip(0.3, 2.5)
    color = _vivid(flat * scale[..., None], VIVID).clip(0, 1)
    return color * (1 - _lines(sight.picture @ LUMINANCE, sight.far, WIDE) ** 0.7)[..., None]


def charcoaled(sight: Sight) -> Map:
    """Broad, soft tones, and thick lines."""
    tone = sight.picture @ LUMINANCE
    grain = noise(torch.from_numpy(sight.points.reshape(-1, 3) / 3)).numpy()
    soft = _soft(tone) - 0.1 * grain.reshape(tone.shape)
    ink = np.maximum(0.9 * expit((0.4 - soft) / 0.13), _lines(tone, sight.far, WIDE))
    return (PAPER + (GRAPHITE - PAPER) * ink)[..., None].repeat(3, -1)


def carved(sight: Sight) -> Map:
    """Ink between cut lines, which are the wider the brighter it is."""
    tone = sight.picture @ LUMINANCE
    calm = _soft(tone)
    up = sight.up / np.linalg.norm(sight.up)
    side: Any = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across = up + ASIDE * side / np.linalg.norm(side)
    phase = sight.points @ across / (CUT * np.linalg.norm(across)) + BEND * gaussian_filter(calm, 4)
    wave = 0.9 * abs(phase % 1 * 2 - 1) + 0.05
    ink = np.maximum(expit((1 - 1.15 * calm - wave) / 0.08), _lines(tone, sight.far, WIDE))
    return PRINTED + (INK - PRINTED) * ink[..., None]


def leaded(sight: Sight) -> Map:
    """Panes of vivid glass between lead."""
    panes = _panes(sight, PANE)
    tinted = panes.colors + TINT * (panes.chance - panes.chance.mean(-1, keepdims=True))
    glass = _vivid(tinted, 2.2).clip(0.02, 1)
    glass = glass * (glass.max(-1, keepdims=True) ** -0.4)
    return glass * (1 - 0.95 * (1 - panes.inward / LEAD).clip(0, 1) ** 0.5)[..., None]


def dotted(sight: Sight) -> Map:
    """Dabs of pure color on pale ground."""
    panes = _panes(sight, DAB)
    dab = _vivid(panes.colors + 0.3 * (panes.chance - 0.5), 1.8).clip(0, 1)
    ground = 0.6 * PAPER + 0.4 * panes.colors
    return ground + (dab - ground) * ((panes.inward - 0.05) / 0.2).clip(0, 1)[..., None]


def planned(sight: Sight) -> Map:
    """White lines on blue, and a little of the tone."""
    tone = sight.picture @ LUMINANCE
    ink = np.maximum(_lines(tone, sight.far), 0.25 * _even(tone, 4))
    return BLUE + (PAPER - BLUE) * ink[..., None]


DRAWN: dict[str, Callable[[Sight], Map]] = {
    "sketch": penciled,
    "comic": inked,
    "charcoal drawing": charcoaled,
    "woodcut": carved,
    "stained glass": leaded,
    "pointillist": dotted,
    "blueprint": planned,
}
"""Styles that no network paints, by name."""
ON_PAPER = {"sketch", "charcoal drawing", "woodcut", "blueprint"}
"""Those of which no color of the scene stays."""


def _lines(tone: Map, far: Map | None, wide: float = 1.0) -> Map:
    """Lines on the dark side of edges and the near side of jumps in depth, in [0, 1]."""
    even = _even(tone, 2)
    busy = _busy(even)
    sizes = [wide * each for each in LINES]
    edges = (gaussian_filter(even, 1.6 * size) - gaussian_filter(even, size) for size in sizes)
    line = np.max([_long(each / (EDGE * busy.clip(1))) for each in edges], 0)
    jumps = 0 if far is None else _long((gaussian_filter(far, 2 * wide) - far) / JUMP)
    return np.maximum(line, jumps)


def _busy(even: Map) -> Map:
    """How many edges a tone without grain has, from 1 on too many."""
    return gaussian_filter(np.abs(gaussian_filter(even, 1.6) - even), 8) / BUSY


def _vivid(picture: Map, factor: float) -> Map:
    """The picture with its saturation raised."""
    gray = (picture @ LUMINANCE)[..., None]
    return gray + factor * (picture - gray)


def _even(tone: Map, radius: int) -> Map:
    """The tone without grain: the guided filter of gsedit.paper.guided, by itself."""
    mean = partial(uniform_filter, size=2 * radius + 1)
    slope = 1 - 0.01 / (0.01 + mean(tone * tone) - mean(tone) ** 2)
    return mean(slope) * tone + mean((1 - slope) * mean(tone))


def _soft(tone: Map) -> Map:
    """The tone of large shapes."""
    return gaussian_filter(_even(_even(tone, 4), 4), 1)


def _calm(picture: Map, radius: int, times: int) -> Map:
    """The picture without grain."""
    for _ in range(times):
        picture = np.stack([_even(each, radius) for each in np.moveaxis(picture, -1, 0)], -1)
    return picture


class Panes(NamedTuple):
    """Cells of space, as pixels show them."""

    colors: Map
    """Mean color of the pane, and a share of what the pixel's own differs by."""
    chance: Map
    """Three numbers in [0, 1) of the pane."""
    inward: Map
    """How much nearer its center is than the next, in its size."""


def _panes(sight: Sight, size: float) -> Panes:
    """Cells about points that are shaken on a grid in space: Worley's noise (1996)."""
    at = sight.points.reshape(-1, 3) / size
    cells = np.unique(np.floor(at), axis=0)
    cells = np.unique((cells[:, None] + NEAR).reshape(-1, 3), axis=0)
    chance = np.sin(cells @ SHAKEN) * 43758.5453 % 1
    found: Any = KDTree(cells + chance).query(at, k=2)
    away, own = found[0], found[1][:, 0]
    calm = _calm(sight.picture, 3, 2).reshape(-1, 3)
    count = np.bincount(own, minlength=len(cells)).clip(1)
    means = np.stack([np.bincount(own, each, len(cells)) / count for each in calm.T], -1)[own]
    shape = sight.picture.shape
    return Panes(
        (means + KEPT * (calm - means)).reshape(shape),
        chance[own].reshape(shape),
        (away[:, 1] - away[:, 0]).reshape(shape[:2]),
    )


def _long(edge: Map) -> Map:
    """Edges as lines, in [0, 1], but for short ones."""
    line = edge.clip(0, 1)
    found: Any = label(line > 0.3, np.ones((3, 3)))
    parts = found[0]
    sides = [np.hypot(*(each.stop - each.start for each in box)) for box in find_objects(parts)]
    length = np.array([0.0, *sides]) / (GRAIN * max(edge.shape))
    return line * (length[parts] - 0.4).clip(0, 1)


def _hatching(tone: Map) -> Map:
    """Strokes, the more and in more directions the darker it is, also against what is around."""
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
