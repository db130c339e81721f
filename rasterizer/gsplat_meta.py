"""gsplat's numbers about the Gaussians: the third result of `rasterization`.

`N` Gaussians, `C` cameras, `...` batch dimensions; an image is one camera of one batch.
"""

from __future__ import annotations

from collections import UserDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.cpp_projection.kernel import Request
from rasterizer.cpp_projection.picture import Prepared
from rasterizer.gsplat_inputs import Cloud, images_of
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.preprocess import Splats
from rasterizer.project import footprint_radii


class Meta(UserDict[str, Any]):
    """A dictionary; a value that takes time is computed when it is first read."""

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        if callable(value):
            value = self.data[name] = value()
        return value


@dataclass(frozen=True, eq=False)
class _Images:
    """Splats of all images, made when they are first needed."""

    clouds: list[Cloud]
    images: list[Prepared | Splats]
    means2d: Float[Tensor, "*batch C N 2"]
    gradients: bool
    """Whether the call had gradients: they are those of what is read later."""

    @cached_property
    def splats(self) -> list[Splats]:
        each = zip(self.images, images_of(self.means2d, 2))
        return [one if isinstance(one, Splats) else one.splats(at) for one, at in each]

    @torch.autocast("cpu", enabled=False)
    def all_rows(self, value_of: Callable[[Cloud, Splats], Tensor]) -> Tensor:
        """From a value for each row in sight, image by image, to [..., C, N, ...]."""
        found, leading = [], self.means2d.shape[:-2]
        with torch.set_grad_enabled(self.gradients):
            for cloud, one in zip(self.clouds, self.splats):
                value = value_of(cloud, one)
                empty = value.new_zeros(self.means2d.shape[-2], *value.shape[1:])
                found.append(empty.index_copy(0, one.rows, value))
            return torch.stack(found).unflatten(0, leading)


def image_meta(
    clouds: list[Cloud],
    request: Request,
    images: list[Prepared | Splats],
    means2d: Float[Tensor, "*batch C N 2"],
) -> Meta:
    """gsplat's numbers, for all rows, zero for those that are not in sight; of any one request."""
    _, _, width, height = request.box
    of = _Images(clouds, images, means2d, torch.is_grad_enabled()).all_rows
    return Meta(
        batch_ids=None,
        camera_ids=None,
        gaussian_ids=None,
        radii=partial(of, lambda _, one: _radii(one, width, height)),
        means2d=means2d,
        depths=partial(of, lambda _, one: one.projected.depth),
        conics=partial(of, lambda _, one: _conics(one.projected.whitening)),
        opacities=partial(of, partial(_opacities, request.numerics)),
        width=width,
        height=height,
        n_batches=means2d.shape[:-3].numel(),
        n_cameras=means2d.shape[-3],
    )


def _opacities(numerics: Numerics, cloud: Cloud, splats: Splats) -> Float[Tensor, " m"]:
    """Opacities of the Gaussians in sight, with antialiasing."""
    if numerics.antialiased:
        return splats.log_opacities.exp()
    return cloud.opacity.index_select(0, splats.rows).to(cloud.means)


def _conics(whitening: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    """W^T W, the inverse covariance: xx, xy, yy."""
    w0, w1, w2 = whitening.unbind(-1)
    return torch.stack((w0 * w0 + w1 * w1, w1 * w2, w2 * w2), -1)


@torch.no_grad()
def _radii(splats: Splats, width: int, height: int) -> Int[Tensor, "m 2"]:
    """Pixels, of the footprints that touch the image; 0 for the others."""
    xy = splats.projected.xy
    radii = footprint_radii(splats.projected, splats.log_opacities, DEFAULT)
    touching = ((xy + radii > 0) & (xy - radii < xy.new_tensor((width, height)))).all(-1)
    return radii * touching[:, None]
