"""Drawings in space: paper and pencil, washes of color.

Lines are where colors of neighbors differ, and where a surface turns away from the eye: that
depends on the view, and is spherical harmonics of degree 2. `n` Gaussians, `d` directions.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.light.color_change import ColorChange, step
from gsedit.scene.quaternions import even_directions
from gsedit.scenery.gloss import VIEWS, added
from gsedit.scenery.setting import CLUMP, LEAF, Setting
from gsedit.toolkit.grade import GAMMA
from rasterizer.numerics import AUTO, Execution, sh_to_color
from rasterizer.scene import Gaussians

PAPER, GRAPHITE = (0.95, 0.94, 0.91), (0.16, 0.16, 0.18)
"""Display colors of paper and of lines."""
RIM = 4
"""Power of 1 less the cosine to the eye, with which a line at the rim of a surface fades."""
PALE, VIVID = 0.75, 1.6
"""Share of its darkness that a wash keeps, and the factor of its saturation."""


def sketch(setting: Setting) -> ColorChange:
    """Pencil on paper: shade in soft tones, lines where colors change."""
    shade = 0.42 * (1 - _spread(setting)) ** 1.5
    grain = 1 + 0.16 * setting.noise(LEAF / 3, 31)
    share = (shade * grain + 0.75 * _lines(setting)).clamp(0, 1)
    paper, graphite = (torch.tensor(each).double() for each in (PAPER, GRAPHITE))
    return _veil(torch.lerp(paper, graphite, share[:, None]))


def watercolor(setting: Setting) -> ColorChange:
    """Washes: colors flow together, are vivid and pale, and pool at their edges."""
    around = setting.found.surface.smoothed(setting.colors, 6)
    brightest = around.amax(-1, keepdim=True)
    gray = around.mean(-1, keepdim=True)
    pale = (1 - PALE * (1 - brightest)) / brightest.clamp_min(0.05)
    vivid = ((gray + VIVID * (around - gray)) * pale).clamp(0, 1)
    thin = 0.25 + 0.13 * setting.noise(CLUMP / 2, 33) + 0.06 * setting.noise(LEAF / 2, 34)
    paper = torch.tensor(PAPER).double()
    pooled = 1 - 0.45 * _lines(setting)
    wash = torch.lerp(vivid, paper.expand_as(vivid), thin.clamp(0, 0.8)[:, None])
    return _veil((wash * pooled[:, None]).clamp(0, 1))


def penciled(setting: Setting, after: Gaussians, execution: Execution = AUTO) -> Gaussians:
    """The drawn scene with pencil lines where it turns away from the eye."""
    surface = setting.found.surface
    views = torch.from_numpy(even_directions(VIEWS)).double()
    away = torch.tensor(GRAPHITE).double() - sh_to_color(after.sh[:, 0].double())
    sure = step(surface.confidence, 0.5, 0.9)
    rims = ((1 - (surface.normals @ view).clamp_min(0)) ** RIM for view in views)
    lines = ((sure * rim)[:, None] * away for rim in rims)
    return added(after, torch.arange(len(after)), views, lines)


def _spread(setting: Setting) -> Float[Tensor, " n"]:
    """Brightness from 0 for the darkest to 1 for the brightest parts of what is seen."""
    luma = setting.found.surface.smoothed(setting.luminance) ** (1 / GAMMA)
    weight = setting.found.seen
    order = luma.argsort()
    rank = weight[order].cumsum(0) / weight.sum().clamp_min(1e-12)
    low, high = (
        luma[order[int(torch.searchsorted(rank, share).clamp_max(len(luma) - 1))]]
        for share in (0.02, 0.98)
    )
    return ((luma - low) / (high - low).clamp_min(1e-6)).clamp(0, 1)


def _lines(setting: Setting) -> Float[Tensor, " n"]:
    """How surely each Gaussian is on a line, in [0, 1]: darker than what is around it."""
    surface = setting.found.surface
    near, far = surface.smoothed(setting.luminance, 1), surface.smoothed(setting.luminance, 6)
    ratio = (near + 0.005) / (far + 0.005)
    return step(ratio ** (1 / GAMMA), 0.97, 0.78)


def _veil(color: Float[Tensor, "n 3"]) -> ColorChange:
    """Other colors instead of the present ones."""
    return ColorChange(1.0, torch.ones_like(color), torch.ones(len(color)).double(), color)
