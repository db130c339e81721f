"""Fit a scene to edited views, on random patches (Efficient-NeRF2NeRF): crops of all views or of
those in which a region shows.

`h w` pixels of a view; a crop is a square of `side` pixels with its top left corner at `y x`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.photometric import supervised
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import UsageError
from gsedit.measures.features import FeatureExtractor
from gsedit.measures.losses import edit_loss
from gsedit.measures.perceptual import INSTALL, is_installed
from gsedit.run.step_threads import StepThreads
from gsedit.views.dataset import View
from rasterizer.camera import Camera
from rasterizer.numerics import Numerics
from rasterizer.project import Box
from rasterizer.render import render


def check_installed(settings: UpdateSettings) -> None:
    """Raise UsageError where the loss needs weights that are not there."""
    if any(term.name == "perceptual" for term in settings.terms) and not is_installed():
        raise UsageError(f"the loss perceptual needs weights that are not installed: {INSTALL}")


MIN_SHOWN_SHARE = 1 / 255
"""A region shows in a pixel of which it is more than this: with less, no color of the region
changes an 8-bit picture by more than a step."""


def random_crop(camera: Camera, side: int, generator: torch.Generator) -> Box:
    """A square of `side` pixels inside the picture: (left, top, width, height).

    Corners are drawn up to half a crop outside and moved in, so that a pixel at a border is in half
    as many crops as one in the middle. Drawn inside only, a picture's outermost row would be in one
    crop where others are in `side`, and the borders of the edited views would keep their colors.
    """
    left = _corner(camera.width - side, side, generator)
    top = _corner(camera.height - side, side, generator)
    return left, top, side, side


def _corner(last: int, side: int, generator: torch.Generator) -> int:
    """Draw the start of a crop along one axis, from 0 to `last`."""
    drawn = int(torch.randint(-(side // 2), last + side // 2 + 1, (), generator=generator))
    return min(max(drawn, 0), last)


def random_patch(
    views: Sequence[View],
    shown: Sequence[Bool[Tensor, "h w"]] | None,
    side: int,
    generator: torch.Generator,
) -> tuple[View, Box]:
    """A random crop of a random view; the whole side where a picture is smaller.

    Where it is given what is `shown` in each view: one of the crops that hold such a pixel, each
    as probable among them as among all, so that crops at a border of what is shown are drawn as
    often as before beside those in its middle. Some crop must hold one.
    """
    side = min(side, *(min(v.camera.width, v.camera.height) for v in views))
    while True:
        index = int(torch.randint(len(views), (), generator=generator))
        box = random_crop(views[index].camera, side, generator)
        if shown is None or cut(shown[index], box).any():
            return views[index], box


def cut(picture: Tensor, box: Box) -> Tensor:
    """The pixels of a picture (its first two dimensions) in a box."""
    left, top, width, height = box
    return picture[top : top + height, left : left + width]


def crops_that_show(shown: Bool[Tensor, "h w"], side: int) -> Bool[Tensor, "y x"]:
    """Whether a pixel of each crop is `shown`, by the crop's top and left."""
    above = F.pad(shown.double().cumsum(0).cumsum(1), (1, 0, 1, 0))  # pixels above and left
    inside = above[side:] - above[:-side]
    return inside[:, side:] > inside[:, :-side]


def share_of_crops(shown: Sequence[Bool[Tensor, "h w"]], side: int) -> float:
    """The probability that a random crop of a random view holds a pixel that is `shown`."""
    side = min(side, *(min(view.shape) for view in shown))  # as `random_patch` draws them
    shares = []
    for view in shown:
        touched = crops_that_show(view, side).double()
        top, left = (_times_drawn(size, side) for size in touched.shape)
        shares.append(float(top @ touched @ left))
    return sum(shares) / len(shares)


def _times_drawn(places: int, side: int) -> Float[Tensor, " y"]:
    """The probability of each place of `random_crop` along one axis."""
    times = torch.ones(places, dtype=torch.float64)
    times[0] += side // 2
    times[-1] += side // 2
    return times / times.sum()


def shown_at(shown: Bool[Tensor, "h w"], width: int, height: int) -> Bool[Tensor, "y x"]:
    """Reduce a mask to a smaller size: True where any pixel is shown."""
    if shown.shape == (height, width):
        return shown
    return F.adaptive_max_pool2d(shown[None].float(), (height, width))[0] > 0


def crops_needed(patches: int, share: float) -> int:
    """Number of crops that show the region, of `patches` random ones, rounded up; at least 1."""
    return max(1, ceil(patches * share - 1e-9))


FELT = Numerics(gradient_min=1 / 1024)
"""Gaussians whose weight in a pixel is below 1/1024 get no gradient from it: all of them together
are 0.1 to 0.2 % of the bear's pictures, and half of what the backward pass would visit."""
APPEARANCE_RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3}
"""Colors learn ten times faster than in 3D Gaussian splatting (2.5e-3, Kerbl et al. 2023): an edit
has a few hundred steps."""
GEOMETRY_RATES = {"log_scales": 2e-3, "quats": 1e-3}
MEANS_RATE = 1.6e-4
"""Times the scene's radius (Kerbl et al.)."""
FINAL_RATE = 0.05
"""Rates fall linearly to this fraction in each round: its last steps average, not chase."""

COARSE_SIZE = 192
"""Pixels. A crop of a large view shows little of the scene, so that most steps are fitted to views
of this longer side up to twice as many pixels."""
COARSE_SHARE = 0.75
"""Share of the steps that run first, before those at full size. On views of 1024 pixels, colors end
6 dB nearer to a known edit than at full size throughout (docs/measurements/editing.md)."""


def rates(geometry: Literal["appearance", "full"], radius: float) -> dict[str, float]:
    """Learning rates by field: of colors and opacities (`appearance`), or of everything (`full`).

    `radius` of the scene, world units: positions move in proportion to it.
    """
    if geometry == "appearance":
        return dict(APPEARANCE_RATES)
    return {**APPEARANCE_RATES, **GEOMETRY_RATES, "means": MEANS_RATE * radius}


@dataclass(frozen=True, eq=False)
class Target:
    """An edited view, and what the update needs of it: made once while it stays as it is."""

    view: View
    shown: Bool[Tensor, "h w"] | None = None
    """Pixels that show the region: patches hold such a pixel. None: all, of every view."""
    patch: int = UpdateSettings.patch
    """Side of a patch, pixels."""

    @cached_property
    def share(self) -> float:
        """The probability that a random patch holds a pixel that is shown."""
        return 1.0 if self.shown is None else share_of_crops([self.shown], self.patch)

    @cached_property
    def small(self) -> View:
        """The copy that the first steps of a round use."""
        return coarse(self.view)

    @cached_property
    def small_shown(self) -> Bool[Tensor, "y x"] | None:
        """`shown`, in the small copy."""
        camera = self.small.camera
        return None if self.shown is None else shown_at(self.shown, camera.width, camera.height)


def update_steps(
    optimizer: SceneOptimizer,
    targets: Sequence[Target],
    seen: Bool[Tensor, " n"],
    span: range,
    steps: int,
    settings: UpdateSettings,
    features: FeatureExtractor,
    generator: torch.Generator,
) -> Iterator[float]:
    """Fit the scene to random patches of the edited views; yields the loss of every step.

    These are the steps `span` of a round of `steps`. Only the Gaussians that are `seen` move; their
    negative base colors are raised before the round's first step. The learning rates fall linearly
    over the round. Of large targets, the first steps use smaller copies. Where the targets say what
    is shown of a region, the patches are those in which it shows.
    """
    threads = StepThreads()
    if span.start == 0:
        optimizer.raise_negative_colors(seen)
    for step in span:
        if step < COARSE_SHARE * steps:
            views, shown = [t.small for t in targets], [t.small_shown for t in targets]
        else:
            views, shown = [t.view for t in targets], [t.shown for t in targets]
        masks = [mask for mask in shown if mask is not None] or None
        patches = [
            random_patch(views, masks, settings.patch, generator) for _ in range(settings.patches)
        ]
        with threads.step():
            drawn = [
                render(optimizer.scene, v.camera, crop=box, numerics=FELT) for v, box in patches
            ]
            rendered = torch.stack([each.color for each in drawn])
            expected = torch.stack([cut(v.image, box) for v, box in patches])
            rendered, expected = supervised(rendered, expected, _masks_of(patches))
            loss = edit_loss(rendered, expected, settings.terms, features)
            loss.backward()
            rate = 1 - (1 - FINAL_RATE) * step / max(1, steps - 1)
            optimizer.step(rate, only=seen)
        yield loss.item()


def _masks_of(patches: Sequence[tuple[View, Box]]) -> Bool[Tensor, "b y x"] | None:
    """The masks of views in the patches; None where no view has one."""
    views = {id(view): view for view, _ in patches}.values()
    masks = {id(view): view.mask for view in views}
    if all(mask is None for mask in masks.values()):
        return None
    everywhere = torch.ones(1, 1, dtype=torch.bool)
    whole = [everywhere.expand(height, width) for _, (_, _, width, height) in patches]
    return torch.stack(
        [
            every if (mask := masks[id(view)]) is None else cut(mask, box)
            for (view, box), every in zip(patches, whole)
        ]
    )


def coarse(view: View) -> View:
    """The view halved until its longer side is below twice COARSE_SIZE; itself where it is."""
    size = view.camera.longest
    factor = 1
    while size // (2 * factor) >= COARSE_SIZE:
        factor *= 2
    if factor == 1:
        return view
    width, height = (max(1, side // factor) for side in (view.camera.width, view.camera.height))
    return view.resized(width, height)
