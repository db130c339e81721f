"""From 3D Gaussians to what is blended of each: cull, check, project, colour.

`n` Gaussians, of which `m` may touch a box of pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import logsigmoid

from rasterizer import checks, harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import Numerics
from rasterizer.project import (
    Box,
    Projected,
    cull,
    effective_log_opacities,
    project,
    view_dependent_colors,
)
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Splats:
    """2D Gaussians that may touch a box of pixels, with what is blended of each."""

    rows: Int[Tensor, " m"]
    """Which Gaussians of the source these are, ascending."""
    projected: Projected
    log_opacities: Float[Tensor, " m"]
    """Natural logarithms, with antialiasing; below the floor where `radius_clip` drops."""
    features: Float[Tensor, "m d"]
    """Colours, then depth: each only where it was asked for."""


class InputNames(NamedTuple):
    """What a caller of the library calls the inputs, for error messages."""

    means: str
    sizes: str
    colors: str


@runtime_checkable
class Source(Protocol):
    """3D Gaussians in some parametrisation."""

    names: ClassVar[InputNames]

    @property
    def means(self) -> Float[Tensor, "n 3"]:
        """Centres, world units."""
        ...

    @property
    def colors(self) -> Float[Tensor, "n ..."]:
        """Spherical harmonics [n k 3], or features [n d]."""
        ...

    def extents(self) -> Float[Tensor, " n"]:
        """At least the largest standard deviation of each, world units."""
        ...

    def opacities(self) -> Float[Tensor, " n"]:
        """In [0, 1]."""
        ...

    def select(self, rows: Int[Tensor, " m"]) -> Source: ...

    def log_opacities(self) -> Float[Tensor, " n"]: ...

    def project(self, camera: Camera, numerics: Numerics) -> Projected: ...


@dataclass(frozen=True, eq=False)
class StoredScene:
    """A scene in the parameters that are stored: see `Gaussians`."""

    names: ClassVar[InputNames] = InputNames("means", "log_scales", "sh")
    scene: Gaussians

    @property
    def means(self) -> Float[Tensor, "n 3"]:
        return self.scene.means

    @property
    def colors(self) -> Float[Tensor, "n k 3"]:
        return self.scene.sh

    def extents(self) -> Float[Tensor, " n"]:
        first, second, third = self.scene.log_scales.unbind(-1)
        return first.maximum(second).maximum(third).exp()

    def opacities(self) -> Float[Tensor, " n"]:
        return self.scene.opacities

    def select(self, rows: Int[Tensor, " m"]) -> StoredScene:
        return StoredScene(self.scene[rows])

    def log_opacities(self) -> Float[Tensor, " n"]:
        return logsigmoid(self.scene.logit_opacities)

    def project(self, camera: Camera, numerics: Numerics) -> Projected:
        return project(self.scene, camera, numerics)


def stored_scene(scene: Gaussians) -> StoredScene:
    """The scene as a source, without harmonics that are zero; ValueError for bad numbers in it."""
    checks.scene(scene)
    return StoredScene(replace(scene, sh=harmonics.without_zero_bands(scene.sh)))


def preprocess(
    source: Source,
    camera: Camera,
    box: Box,
    numerics: Numerics,
    *,
    color: bool = True,
    depth: bool = False,
) -> Splats:
    """What a box of the camera's pixels may show of a source; differentiable in source and pose.

    Raises ValueError for a camera or a setting that is not usable, for a box that is empty or
    leaves the picture, and for colours or footprints in sight that are not finite.
    """
    checks.settings(numerics)
    checks.camera(camera)
    checks.crop(box, camera)
    with torch.no_grad():
        rows = cull(source.means, source.extents(), source.opacities(), camera, box, numerics)
    visible = source.select(rows)
    projected = visible.project(camera, numerics)
    checks.footprints(projected, rows, source.names[:2])
    features = []
    if color:
        features.append(_colors(visible, rows, camera))
    if depth:
        features.append(projected.depth[:, None])
    return Splats(
        rows=rows,
        projected=projected,
        log_opacities=effective_log_opacities(projected, visible.log_opacities(), numerics),
        features=torch.cat(features, -1) if features else projected.xy.new_empty(len(rows), 0),
    )


def _colors(visible: Source, rows: Int[Tensor, " m"], camera: Camera) -> Float[Tensor, "m d"]:
    """Features as they are, harmonics as colours; ValueError unless they are finite."""
    checks.finite(visible.names.colors, visible.colors, rows)
    if visible.colors.ndim == 2:
        return visible.colors
    colors = view_dependent_colors(visible.colors, visible.means, camera)
    checks.finite(visible.names.colors, colors, rows)  # sums of finite numbers may overflow
    return colors
