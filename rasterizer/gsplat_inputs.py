"""The arguments of gsplat's `rasterization`, checked, as the sources and cameras of images.

`N` Gaussians, `C` cameras, `D` channels, `K` harmonics, `...` batch dimensions; an image is one
camera of one batch. `leading` is the shape (..., C) of all images.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import checks, harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import Numerics
from rasterizer.preprocess import InputNames
from rasterizer.project import Projected, project_axes, rotation_matrices
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Cloud:
    """A `preprocess.Source`: Gaussians of covariance A A^T, with A = R(quats) diag(scales)."""

    names: ClassVar[InputNames] = InputNames("means", "scales", "colors")
    means: Float[Tensor, "n 3"]
    opacity: Float[Tensor, " n"]
    color: Float[Tensor, "n ..."]
    quats: Float[Tensor, "n 4"]
    scales: Float[Tensor, "n 3"]

    def opacities(self) -> Float[Tensor, " n"]:
        return self.opacity

    def log_opacities(self, rows: Int[Tensor, " m"]) -> Float[Tensor, " m"]:
        return self.opacity[rows].to(self.means).log()  # of rows in sight: opacity 0 is culled

    def colors(self, rows: Int[Tensor, " m"]) -> Float[Tensor, "m ..."]:
        return self.color[rows].to(self.means)

    def extents(self) -> Float[Tensor, " n"]:
        return self.scales.detach().abs().amax(-1)

    def gaussians(self, *, color: bool) -> Gaussians:
        """Scales and opacities in the places of logarithms and logits, for `front.prepare`.

        Harmonics only where they are asked for: features, and depth alone, need none.
        """
        harmonic = color and self.color.ndim == 3
        sh = self.color.to(self.means) if harmonic else self.means.new_empty(len(self.means), 0, 3)
        return Gaussians(self.means, self.quats, self.scales, self.opacity, sh)

    def project(self, rows: Int[Tensor, " m"], camera: Camera, numerics: Numerics) -> Projected:
        axes = rotation_matrices(self.quats[rows]) * self.scales[rows][:, None, :]
        return project_axes(self.means[rows], axes, camera, numerics)


def image_clouds(
    means: Float[Tensor, "..."],
    quats: Float[Tensor, "..."],
    scales: Float[Tensor, "..."],
    opacities: Float[Tensor, "..."],
    colors: Float[Tensor, "..."],
    leading: tuple[int, ...],
    sh_degree: int | None,
) -> list[Cloud]:
    """The Gaussians of each image; the shapes are `rasterization`'s, and checked here.

    Raises ValueError for shapes that do not fit together.
    """
    shape = tuple(means.shape[:-1])
    count, views = shape[-1], leading[-1]

    def by_image(name: str, values: Tensor, *columns: int) -> list[Tensor]:
        expect_shape(name, values, (*shape, *columns))
        return [one for one in images_of(values, 1 + len(columns)) for _ in range(views)]

    fields = (
        by_image("means", means, 3),
        by_image("opacities", opacities),
        _image_colors(colors, leading, count, sh_degree),
        by_image("quats", quats, 4),
        by_image("scales", scales, 3),
    )
    return [Cloud(*one) for one in zip(*fields)]


def _image_colors(
    colors: Float[Tensor, "..."], leading: tuple[int, ...], count: int, sh_degree: int | None
) -> list[Float[Tensor, "N ..."]]:
    """Each image's features [N, D], or harmonics [N, K, 3] without the bands that are not used."""
    tail = 1 if sh_degree is None else 2
    shared = colors.dim() == len(leading) + tail  # by the cameras of a batch
    used = (*leading[:-1], count) if shared else (*leading, count)
    if sh_degree is not None:
        bands = (sh_degree + 1) ** 2
        if colors.dim() < 2 or colors.shape[-2] < bands:
            raise ValueError(f"colors has shape {list(colors.shape)}; degree {sh_degree} takes at "
                             f"least {bands} coefficients of 3")  # fmt: skip
        expect_shape("colors", colors, (*used, colors.shape[-2], 3))
        colors = colors if colors.shape[-2] == bands else colors[..., :bands, :]
    else:
        expect_shape("colors", colors, (*used, colors.shape[-1]))
    images = images_of(colors, tail + 1)
    if sh_degree is not None:
        images = [harmonics.without_zero_bands(image) for image in images]
    return [image for image in images for _ in range(leading[-1] if shared else 1)]


def image_cameras(
    viewmats: Float[Tensor, "..."],
    Ks: Float[Tensor, "..."],
    leading: tuple[int, ...],
    template: Camera,
) -> list[Camera]:
    """`template` at every image's pose [..., C, 4, 4], with its intrinsics [..., C, 3, 3].

    Raises ValueError for other shapes, NaN or infinity.
    """
    checks.all_finite("viewmats", expect_shape("viewmats", viewmats, (*leading, 4, 4)))
    checks.all_finite("Ks", expect_shape("Ks", Ks, (*leading, 3, 3)))
    poses, intrinsics = viewmats.reshape(-1, 4, 4), Ks.reshape(-1, 3, 3).tolist()
    return [
        replace(template, world_to_camera=pose, fx=k[0][0], fy=k[1][1], cx=k[0][2], cy=k[1][2])
        for pose, k in zip(poses, intrinsics)
    ]


def images_of(values: Float[Tensor, "..."], dims: int) -> list[Tensor]:
    """The tensors of `dims` dimensions that another holds. One alone copies no gradient."""
    count, alone = values.shape[:-dims].numel(), values.shape[-dims:]
    return [values.reshape(alone)] if count == 1 else [*values.reshape(count, *alone)]


def expect_shape(name: str, tensor: Tensor, shape: tuple[int, ...]) -> Tensor:
    """The tensor; ValueError unless it has the shape."""
    if tuple(tensor.shape) != shape:
        raise ValueError(
            f"{name} has shape {list(tensor.shape)}; {list(shape)} would fit means and viewmats"
        )
    return tensor


def refuse_unsupported(**options: Any) -> None:
    """NotImplementedError for options that gsplat has and this has not; None and False are off."""
    for name, value in options.items():
        if value is not None and value is not False:
            raise NotImplementedError(f"{name}={value!r} is not implemented on a CPU")


def expect_one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    """ValueError unless the value is allowed."""
    if value not in allowed:
        raise ValueError(f"{name} {value!r} is none of {', '.join(allowed)}")
