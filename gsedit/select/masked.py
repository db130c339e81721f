"""Masks of views: those that a person drew, and those that a network draws of what a phrase names.

A network's may be noisy: views that miss it, show something else, or have soft or wide borders.
`n` Gaussians; maps of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_matrix
from torch import Tensor

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.pictures import open_picture
from gsedit.run.inputs import existing_file
from gsedit.scene.neighbors import linked
from gsedit.select.layers import numbered
from gsedit.select.region import (
    MIN_SEEN_PIXELS,
    Lifted,
    Region,
    lift,
    otsu,
    smoothed,
    within_silhouette,
)
from gsedit.select.surfaces import neighbors
from gsedit.views.around import cameras_of
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.image_ops import downscale
from gsedit.views.undistort import Lens, undistort, undistortion
from gsedit.views.view_pictures import view_of
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

MOST_VIEWS = 16
"""Most views that a provider is asked about, evenly spaced: networks take seconds for each."""
VIEW_PIXELS = 512
"""Longest side of their pictures: networks see them at 352 (CLIPSeg) to 1024 pixels (SAM)."""
SILENT = 0.5
"""Largest value of a mask's surest pixel, of that of all masks, whose view does not vote: it shows
nothing of what is asked for, or missed it, and may be the only one to see that side."""
BIAS = 0.55
"""Least value inside, of that one. Of thresholds from 0.2 to 0.8, fixed and relative, the best on
15 things of six synthetic stages under nine kinds of noise (docs/measurements/regions.md)."""
LEAST_SURE = 0.3
"""Least value of the surest pixel of all masks: soft ones are not 0 where nothing is. A guess."""
ALIKE, LEAST_PART = 0.75, 0.02
"""Least mean value of a connected part, of the largest's, and its least share of that one's pixels:
less is something else, which some views took for it."""


@runtime_checkable
class MaskProvider(Protocol):
    """Finds what a phrase names in pictures, each on its own."""

    @property
    def name(self) -> str:
        """Name by which it is chosen."""
        ...

    def check(self, phrase: str) -> None:
        """Raise UsageError for a phrase that it cannot look for, before any picture is made."""
        ...

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield the probability of each pixel to show it, a map a picture, in their order and size.

        Pictures are in [0, 1]. A picture that does not show it has a map of zeros.
        """
        ...


def find_masked(
    phrase: str, scene: Gaussians, provider: MaskProvider, cameras: Sequence[Camera] = ()
) -> Region:
    """The Gaussians of what a provider finds in pictures of the scene, seen by these cameras.

    Without cameras, viewpoints are found. Raises UsageError for a phrase that the provider cannot
    look for, or finds in no view; GseditError for masks of another size or with NaN.
    """
    provider.check(phrase)
    looked = _views(scene, cameras)
    pictures = [render(scene, each).color.clamp(0, 1) for each in looked]
    made = list(provider.masks(pictures, phrase))
    sizes = [tuple(mask.shape) for mask in made], [(c.height, c.width) for c in looked]
    if sizes[0] != sizes[1] or not all(mask.isfinite().all() for mask in made):
        raise GseditError(
            f"the masks {provider.name!r} gave {len(made)} maps for {len(looked)} pictures, one of "
            "another size, or one with NaN: ask their authors"
        )
    masks = [mask.float().clamp(0, 1) for mask in made]
    inside = lift_masks(scene, looked, masks)
    best = max((float(mask.max()) for mask in masks), default=0.0)
    if best < LEAST_SURE or not inside.any():
        raise UsageError(
            f"the masks {provider.name!r} find no {phrase!r} in {len(masks)} views (the surest "
            f"pixel has {best:.2f} of 1): say it in other words"
        )
    shown = sum(float(mask.max()) >= LEAST_SURE for mask in masks)
    return Region(inside, f"{phrase!r} by {provider.name}, in {shown} of {len(masks)} views")


@torch.no_grad()
def lift_masks(
    scene: Gaussians, cameras: Sequence[Camera], masks: Sequence[Float[Tensor, "_ _"]]
) -> Bool[Tensor, " n"]:
    """Whether each Gaussian is inside, by the vote of all views' masks (in [0, 1], a camera each).

    A Gaussian's value is the mean of the masks over the pixels that it gives, smoothed over its
    neighbors, which is the optimum of FlashSplat's linear program (Shen et al. 2024) but for the
    bias against the background: that is relative, since masks that are missing, soft or faint
    lower the values of all. Nothing is inside where hardly a view has a mask.
    """
    best = max((float(mask.max()) for mask in masks), default=0.0)
    said = [i for i, mask in enumerate(masks) if float(mask.max()) >= SILENT * best]
    cameras, masks = [cameras[i] for i in said], [masks[i] for i in said]
    lifted, graph = lift(scene, cameras, masks), neighbors(scene)
    values = smoothed(lifted, graph)
    likely = (values > otsu(values, lifted.weight)) & (lifted.weight > MIN_SEEN_PIXELS)
    top = float(values[likely].quantile(0.9)) if likely.any() else 0.0
    if top < 0.05:  # hardly a view has a mask
        return torch.zeros_like(likely)
    inside = _alike(values > BIAS * top, values, lifted, graph)
    return within_silhouette(scene, cameras, inside)


def _alike(
    inside: Bool[Tensor, " n"], values: Float[Tensor, " n"], lifted: Lifted, graph: csr_matrix
) -> Bool[Tensor, " n"]:
    """The connected parts about whose values the views agree as about the largest one's."""
    among, (first, second) = inside.numpy(), graph.nonzero()
    pairs = np.stack((first, second), 1)[among[first] & among[second]].astype(np.int64)
    number = torch.from_numpy(numbered(linked(pairs, len(inside)), among) + 1)
    weight, total = (
        torch.zeros(int(number.max()) + 1).index_add_(0, number, each.float())
        for each in (lifted.weight, lifted.weight * values)
    )
    weight[0] = total[0] = 0  # of what is in no part
    largest = total.argmax()
    mean = total / weight.clamp_min(1e-9)
    kept = (mean >= ALIKE * mean[largest]) & (weight >= LEAST_PART * weight[largest])
    kept[0] = False
    return kept[number]


def _views(scene: Gaussians, cameras: Sequence[Camera]) -> list[Camera]:
    cameras = cameras_of(scene, cameras, MOST_VIEWS, VIEW_PIXELS)
    chosen = [cameras[i] for i in evenly_spaced(len(cameras), MOST_VIEWS)]
    return [c if max(c.width, c.height) <= VIEW_PIXELS else c.fitted(VIEW_PIXELS) for c in chosen]


def read_masks(
    path: Path, views: Sequence[View | Viewpoint], *, others: bool = False
) -> dict[int, Float[Tensor, "h w"]]:
    """The masks in a PNG, or in all PNGs of a folder, by the index of the view that they belong to.

    A mask has the name of its view's picture: `frame_00001.png` belongs to the view
    `images/frame_00001.jpg`, and is drawn on the photo, whose lens distortion is undone; so does
    `000_frame_00001.png`, as `gsedit render` names the view, where there is none. White is inside,
    black and transparent outside. It may have another size than the view, and is averaged over the
    view's pixels. Raises InputError where no file is there, a name belongs to several
    views or to none (with `others`: all to none), or a mask has another shape than its view.
    """
    files = sorted(path.glob("*.png")) if path.is_dir() else [existing_file(path)]
    if not files:
        raise InputError(f"{path} has no .png file: put masks there, named after their views")
    names = [Path(view.name).name for view in views]
    masks: dict[int, Tensor] = {}
    found = [view_of(Path(file.name), names) for file in files]
    for index, file in zip(found, files):
        if index is None:
            if others and set(found) != {None}:
                continue
            listed = ", ".join(Path(name).stem for name in names[:4])
            raise InputError(
                f"{file} belongs to no view: name it after a view's picture ({listed}, ...) with "
                ".png"
            )
        camera, lens = views[index].camera, views[index].lens
        is_photo = file.stem == Path(views[index].name).stem
        masks[index] = read_mask(file, camera.width, camera.height, lens if is_photo else None)
    return masks


def read_mask(
    file: Path, width: int, height: int, lens: Lens | None = None
) -> Float[Tensor, "{height} {width}"]:
    """The mask in a picture, averaged over the pixels of a view: white is 1, black and transparent
    0. The distortion of a lens is undone. Raises InputError for a file that is no picture, or of
    another shape than the view."""
    with open_picture(file) as picture:
        levels = np.array(picture.convert("LA"))
    brightness, opacity = torch.from_numpy(levels).float().div(255).unbind(-1)
    mask = brightness * opacity
    rows, columns = mask.shape
    if abs(columns / rows - width / height) > 0.02 * width / height:
        raise InputError(
            f"{file} is {columns}x{rows} and its view {width}x{height}: draw it on the same picture"
        )
    if lens is not None:
        mask = undistort(mask[..., None], undistortion(lens.scaled(columns, rows)))[..., 0]
    return downscale(mask[..., None], width, height)[..., 0].clamp(0, 1)
