"""Compensate new Gaussians for the haze of faint floaters in front of them.

A capture's own colors were fitted through that haze; without compensation, new ones look dull.
`m` new Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsedit.datasets.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution, color_to_sh, sh_to_color
from rasterizer.render import render
from rasterizer.scene import Gaussians

VIEWS, VIEW_PIXELS = 6, 128
"""Cameras that haze is measured from, and the longer side of their pictures."""
SEEN, SOLID = 0.5, 0.9
"""Least part of new Gaussians in a pixel that tells, and least opacity of them alone there."""
FEWEST = 20
"""Pixels below which nothing is told."""
LEAST, MOST = 0.95, 1.25
"""Range of the factor: beyond it, something stands before them that is no haze."""


def unveiled(
    grown: Gaussians, new: Gaussians, cameras: Sequence[Camera], execution: Execution = AUTO
) -> Gaussians:
    """New Gaussians, the last of a grown scene, in colors that show as they are through what is
    before them: a factor a channel, the mean over the cameras."""
    marks = torch.arange(len(grown)) >= len(grown) - len(new)
    shown, wanted, count = torch.zeros(3).double(), torch.zeros(3).double(), 0
    for i in evenly_spaced(len(cameras), VIEWS):
        camera = cameras[i].fitted(VIEW_PIXELS)
        whole = render(grown, camera, marked=marks, execution=execution)
        alone = render(new, camera, execution=execution)
        assert whole.marked is not None
        told = (whole.marked > SEEN) & (alone.alpha > SOLID)
        color = (alone.color[told] / alone.alpha[told][:, None]).double()
        part = whole.marked[told][:, None] * color
        shown += part.sum(0)
        wanted += (color - (whole.color[told] - part)).sum(0)
        count += int(told.sum())
    if count < FEWEST:
        return new
    gain = (wanted / shown.clamp_min(1e-9)).clamp(LEAST, MOST)
    sh = new.sh.clone()
    sh[:, 0] = color_to_sh(sh_to_color(sh[:, 0].double()) * gain).to(sh)
    return replace(new, sh=sh)
