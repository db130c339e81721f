"""gsplat's numbers about the Gaussians: the third result of `rasterization`.

`N` Gaussians, `C` cameras, `...` batch dimensions; an image is one camera of one batch.
"""

from __future__ import annotations

from collections import UserDict
from collections.abc import Callable
from functools import cache
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer.cpp_projection.kernel import Request
from rasterizer.cpp_projection.picture import Prepared
from rasterizer.gsplat_inputs import Cloud
from rasterizer.numerics import DEFAULT
from rasterizer.preprocess import Splats
from rasterizer.project import footprint_radii


class Meta(UserDict[str, Any]):
    """A dictionary; a value that takes time is computed when it is first read."""

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        if callable(value):
            value = self.data[name] = value()
        return value


def image_meta(
    clouds: list[Cloud],
    requests: list[Request],
    images: list[Prepared | Splats],
    means2d: Float[Tensor, "*batch C N 2"],
) -> Meta:
    """gsplat's numbers, for all rows; zero for those that are not in sight."""
    *batch, cameras, count, _ = means2d.shape
    (_, _, width, height), numerics = requests[0].box, requests[0].numerics

    @cache
    def splats() -> list[Splats]:
        return [
            one if isinstance(one, Splats) else one.splats(at)
            for one, at in zip(images, means2d.flatten(0, -3))
        ]

    def lazily(value_of: Callable[[Cloud, Splats], Tensor]) -> Callable[[], Tensor]:
        """A value for each row in sight, image by image; to [..., C, N, ...] when it is called."""

        @torch.set_grad_enabled(torch.is_grad_enabled())
        @torch.autocast("cpu", enabled=False)
        def all_rows() -> Tensor:
            found = []
            for cloud, one in zip(clouds, splats()):
                value = value_of(cloud, one)
                empty = value.new_zeros(count, *value.shape[1:])
                found.append(empty.index_copy(0, one.rows, value))
            return torch.stack(found).unflatten(0, (*batch, cameras))

        return all_rows

    def opacities(cloud: Cloud, one: Splats) -> Tensor:
        if numerics.antialiased:
            return one.log_opacities.exp()
        return cloud.opacity.index_select(0, one.rows).to(cloud.means)

    return Meta(
        batch_ids=None,
        camera_ids=None,
        gaussian_ids=None,
        radii=lazily(lambda _, one: _radii(one, width, height)),
        means2d=means2d,
        depths=lazily(lambda _, one: one.projected.depth),
        conics=lazily(lambda _, one: _conics(one.projected.whitening)),
        opacities=lazily(opacities),
        width=width,
        height=height,
        n_batches=means2d.shape[:-3].numel(),
        n_cameras=cameras,
    )


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
