"""From 3D Gaussians to what is blended of each: cull, check, project, color.

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
    """2D Gaussians that may touch a box of pixels; `features_of` gives what they show."""

    rows: Int[Tensor, " m"]
    """Row numbers in the source, ascending."""
    projected: Projected
    log_opacities: Float[Tensor, " m"]
    """Natural logarithms, with antialiasing; below the floor where `radius_clip` drops."""


class InputNames(NamedTuple):
    """Names that a caller has for the inputs, for error messages."""

    means: str
    sizes: str
    colors: str


@runtime_checkable  # the tests check annotations at run time
class Source(Protocol):
    """3D Gaussians in some parametrisation; what takes `rows` computes it of those only."""

    names: ClassVar[InputNames]

    @property
    def means(self) -> Float[Tensor, "n 3"]:
        """Positions of the centers, world units."""
        ...

    def extents(self) -> Float[Tensor, " n"]:
        """At least the largest standard deviation of each, world units."""
        ...

    def opacities(self) -> Float[Tensor, " n"]:
        """Opacities, each in [0, 1]."""
        ...

    def log_opacities(self, rows: Int[Tensor, " m"]) -> Float[Tensor, " m"]:
        """Natural logarithms of the opacities."""
        ...

    def colors(self, rows: Int[Tensor, " m"]) -> Float[Tensor, "m ..."]:
        """Spherical harmonics [m k 3], or features [m d]."""
        ...

    def project(self, rows: Int[Tensor, " m"], camera: Camera, numerics: Numerics) -> Projected: ...


@dataclass(frozen=True, eq=False)
class StoredScene:
    """A scene in the parameters that are stored: see `Gaussians`."""

    names: ClassVar[InputNames] = InputNames("means", "log_scales", "sh")
    scene: Gaussians

    @property
    def means(self) -> Float[Tensor, "n 3"]:
        return self.scene.means

    def extents(self) -> Float[Tensor, " n"]:
        first, second, third = self.scene.log_scales.unbind(-1)
        return first.maximum(second).maximum(third).exp()

    def opacities(self) -> Float[Tensor, " n"]:
        return self.scene.opacities

    def log_opacities(self, rows: Int[Tensor, " m"]) -> Float[Tensor, " m"]:
        return logsigmoid(self.scene.logit_opacities.index_select(0, rows))

    def colors(self, rows: Int[Tensor, " m"]) -> Float[Tensor, "m k 3"]:
        return self.scene.sh.index_select(0, rows)

    def project(self, rows: Int[Tensor, " m"], camera: Camera, numerics: Numerics) -> Projected:
        no_colors = replace(self.scene, sh=self.scene.sh[:, :0])  # most of a row, and not read
        return project(no_colors[rows], camera, numerics)


def stored_scene(scene: Gaussians) -> StoredScene:
    """The scene as a source, without harmonics that are zero; ValueError for bad numbers in it."""
    checks.scene(scene)
    return StoredScene(replace(scene, sh=harmonics.without_zero_bands(scene.sh)))


def preprocess(source: Source, camera: Camera, box: Box, numerics: Numerics) -> Splats:
    """The Gaussians of a source that may touch a box of the camera's pixels, without features.

    Differentiable in source and pose. Raises ValueError for a camera or a setting that is not
    usable, for a box that is empty or leaves the picture, and for footprints in sight that are not
    finite.
    """
    checks.settings(numerics)
    checks.camera(camera)
    checks.crop(box, camera)
    with torch.no_grad():
        rows = cull(source.means, source.extents(), source.opacities(), camera, box, numerics)
    projected = source.project(rows, camera, numerics)
    checks.footprints(projected, rows, (source.names.means, source.names.sizes))
    log_opacities = effective_log_opacities(projected, source.log_opacities(rows), numerics)
    return Splats(rows, projected, log_opacities)


def features_of(
    source: Source, splats: Splats, camera: Camera, *, color: bool = True, depth: bool = False
) -> Float[Tensor, "m d"]:
    """Compute the blended features of each splat: color, then depth, each only if asked for.

    A step of its own, for features may be most of the memory: of several images, one at a time
    needs them. Differentiable. Raises ValueError for colors in sight that are not finite.
    """
    features = [splats.log_opacities.new_empty(len(splats.rows), 0)]
    if color:
        features.append(colors_of(source, splats.rows, camera))
    if depth:
        features.append(splats.projected.depth[:, None])
    return features[1] if len(features) == 2 else torch.cat(features, -1)


def colors_of(source: Source, rows: Int[Tensor, " m"], camera: Camera) -> Float[Tensor, "m d"]:
    """Features as they are, harmonics as colors; ValueError unless they are finite."""
    values = source.colors(rows)
    checks.finite(source.names.colors, values, rows)
    if values.ndim == 2:
        return values
    colors = view_dependent_colors(values, source.means.index_select(0, rows), camera)
    checks.finite(source.names.colors, colors, rows)  # sums of finite numbers may overflow
    return colors
