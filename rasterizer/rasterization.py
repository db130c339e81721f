"""gsplat's `rasterization` on a CPU: the same arguments by name, the same three results.

Conventions: gsplat 1.5, https://docs.gsplat.studio/main/apis/rasterization.html. `N` Gaussians,
`C` cameras, `D` channels, `K` harmonics, `...` batch dimensions; an image is one camera of one
batch, and `leading` the shape (..., C) of all images; `K` harmonics.
"""

from __future__ import annotations

from collections import UserDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import prod
from typing import Any, ClassVar, Literal, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import checks, harmonics
from rasterizer.blending.backend import Blended
from rasterizer.camera import Camera
from rasterizer.cpp_projection.kernel import Request
from rasterizer.cpp_projection.picture import Prepared, prepare
from rasterizer.numerics import AUTO, DEFAULT, Execution, Numerics
from rasterizer.preprocess import InputNames, Splats, colors_of, features_of, preprocess
from rasterizer.project import (
    Projected,
    covariance_of,
    footprint_radii,
    project_axes,
    rotation_matrices,
)
from rasterizer.scene import Gaussians
from rasterizer.splat import splat


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


RenderMode = Literal["RGB", "D", "ED", "RGB+D", "RGB+ED"]

LEAST_BLUR = 1e-10  # square pixels: a line of no width has no picture
LEAST_ALPHA = 1e-10  # gsplat's, in the depth of ED


@torch.autocast("cpu", enabled=False)
def rasterization(
    means: Float[Tensor, "*batch N 3"],
    quats: Float[Tensor, "*batch N 4"],
    scales: Float[Tensor, "*batch N 3"],
    opacities: Float[Tensor, "*batch N"],
    colors: Float[Tensor, "..."],
    viewmats: Float[Tensor, "*batch C 4 4"],
    Ks: Float[Tensor, "*batch C 3 3"],
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int | None = None,
    backgrounds: Float[Tensor, "*batch C D"] | None = None,
    render_mode: RenderMode = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: Literal["classic", "antialiased"] = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Tensor | None = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Tensor | None = None,
    tangential_coeffs: Tensor | None = None,
    thin_prism_coeffs: Tensor | None = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = None,
    viewmats_rs: Tensor | None = None,
    *,
    execution: Execution | None = None,
) -> tuple[Float[Tensor, "*batch C h w X"], Float[Tensor, "*batch C h w 1"], Meta]:
    """Render N Gaussians into the images of C cameras, as gsplat does.

    Arguments
    - `quats` wxyz, any norm; `scales` standard deviations (not logarithms); `opacities` in [0, 1].
    - `colors`: features [..., (C,) N, D], any D; with `sh_degree` (0 to 4) harmonics
      [..., (C,) N, K, 3], of which the first (sh_degree + 1)^2 are used, and color + 0.5 is not
      below 0.
    - `viewmats`: rigid, world to camera, OpenCV axes. `Ks`: pixels; skew is not read.
    - `camera_model` "pinhole" or "ortho" (x of a pixel is fx x + cx, at any depth).
    - `near_plane`, `far_plane`: Gaussians with near < z <= far are drawn.
    - `eps2d`: pixel variance added to each projected covariance; at least 1e-10.
    - `radius_clip`: Gaussians with both radii at most this, pixels, are not drawn.
    - `rasterize_mode` "antialiased": opacities times sqrt(det(cov) / det(cov + eps2d)).
    - `tile_size`: None chooses one per image, from the footprints. Changes time only.
    - `execution`: how it is computed; `tile_size`, where given, replaces the one in it.
    - `packed`, `channel_chunk`, `segmented` are ignored: in gsplat they trade memory for time.

    Returns
    - colors [..., C, h, w, X]: X is D, then depth as the last channel with +D (the sum of
      weights times z) or +ED (that over alpha); depth alone for D and ED, which blend no colors.
      `backgrounds` lie behind the colors, 0 behind depth.
    - alphas [..., C, h, w, 1].
    - meta, shaped as with packed=False and zero for what is not drawn: means2d [..., C, N, 2]
      (`.grad` is there after a backward pass), radii [..., C, N, 2] int32 pixels (computed when
      they are first read), width, height, tile_size, tile_width, tile_height (of the first image),
      n_batches, n_cameras; gaussian_ids is None.

    The compiled front end prepares the Gaussians, as for `render`; torch does for gradients of
    `viewmats`, and where `execution` rules the kernel out.

    Differentiable in all tensors but `Ks` (as in gsplat). Float32 or float64, as `means` is.
    The stop differs: gsplat leaves out the Gaussian after which less than 1e-4 would pass a pixel,
    and all behind it; here the image is wrong by at most 1e-5 of a color.

    Raises NotImplementedError for an option of gsplat's that is not implemented, and ValueError for
    shapes that do not fit together and for NaN or infinity in an input, with its name and the first
    row (of `colors`: of those in sight).
    """
    refuse_unsupported(
        sparse_grad=sparse_grad,
        absgrad=absgrad,
        distributed=distributed,
        covars=covars,
        with_ut=with_ut,
        with_eval3d=with_eval3d,
        radial_coeffs=radial_coeffs,
        tangential_coeffs=tangential_coeffs,
        thin_prism_coeffs=thin_prism_coeffs,
        ftheta_coeffs=ftheta_coeffs,
        viewmats_rs=viewmats_rs,
        rolling_shutter=getattr(rolling_shutter, "name", rolling_shutter) not in (None, "GLOBAL"),
    )
    expect_one_of("render_mode", render_mode, get_args(RenderMode))
    expect_one_of("rasterize_mode", rasterize_mode, ("classic", "antialiased"))
    leading = (*means.shape[:-2], viewmats.shape[-3])
    images = prod(leading)
    if not images:
        raise ValueError("there is no camera: viewmats, or a batch dimension, is empty")
    clouds = image_clouds(means, quats, scales, opacities, colors, leading, sh_degree)
    cameras = image_cameras(viewmats, Ks, leading, _template(width, height, camera_model))
    if backgrounds is not None:
        checks.all_finite("backgrounds", backgrounds)
        expect_shape("backgrounds", backgrounds, (*leading, colors.shape[-1]))
        backgrounds = backgrounds.reshape(images, -1)
    numerics = Numerics(
        blur=max(eps2d, LEAST_BLUR),
        antialiased=rasterize_mode == "antialiased",
        near=near_plane,
        far=far_plane,
        radius_clip=radius_clip,
    )
    execution = execution or AUTO
    if tile_size is not None:
        execution = replace(execution, tile_size=tile_size)

    color, depth = "RGB" in render_mode, _has_depth(render_mode)
    requests = [
        Request(camera, (0, 0, width, height), numerics, execution, depth, linear=True)
        for camera in cameras
    ]
    known = [prepare(c.gaussians(color=color), one) for c, one in zip(clouds, requests)]
    if not all(known):  # the compiled front end has looked at the numbers already
        given = {"means": means, "opacities": opacities, "quats": quats, "scales": scales}
        for name, values in given.items():
            checks.finite(name, values)
    images = [
        one or preprocess(cloud, request.camera, request.box, numerics)
        for one, cloud, request in zip(known, clouds, requests)
    ]
    # blended at meta["means2d"], so that it takes the gradient of the positions
    means2d = _stacked([_centers(one, means.shape[-2]) for one in images]).unflatten(0, leading)
    if means2d.requires_grad:
        means2d.retain_grad()
    # features, which may be larger than all else, live for one image at a time
    each = zip(clouds, requests, images, images_of(means2d, 2))
    pictures, sizes = zip(*(_picture(*one, color=color) for one in each))
    meta = Meta(
        gaussian_ids=None,
        radii=partial(_radii, images, means2d, (width, height)),
        means2d=means2d,
        width=width,
        height=height,
        n_batches=means2d.shape[:-3].numel(),
        n_cameras=means2d.shape[-3],
        tile_size=sizes[0],
        tile_width=-(-width // sizes[0]),
        tile_height=-(-height // sizes[0]),
    )
    picture, alphas = _composed(pictures, render_mode, backgrounds)
    return picture.unflatten(0, leading), alphas.unflatten(0, leading), meta


def _template(width: int, height: int, model: str) -> Camera:
    """A camera with the picture's size and the model; NotImplementedError for another model."""
    if model not in ("pinhole", "ortho"):
        raise NotImplementedError(f"camera_model={model!r}: pinhole and ortho are here")
    camera = Camera(torch.eye(4), 1.0, 1.0, 0.0, 0.0, width, height)
    return replace(camera, model="ortho" if model == "ortho" else "pinhole")


class Meta(UserDict[str, Any]):
    """The numbers that gsplat's strategies read; one that takes time is computed when read."""

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        if callable(value):
            value = self.data[name] = value()
        return value


@torch.no_grad()
def _radii(
    images: list[Prepared | Splats], means2d: Float[Tensor, "*batch C N 2"], size: tuple[int, int]
) -> Int[Tensor, "*batch C N 2"]:
    """Pixels, of the footprints that touch their image; 0 for the others."""
    found = []
    for one, centers in zip(images, images_of(means2d, 2)):
        if isinstance(one, Prepared):
            rows, covariance = one.listed.rows.long(), covariance_of(one.table[:, 2:5])
            log_opacities = one.table[:, 5]
        else:
            rows, covariance = one.rows, one.projected.covariance
            log_opacities = one.log_opacities
        xy, radii = centers[rows], footprint_radii(covariance, log_opacities, DEFAULT)
        touching = ((xy + radii > 0) & (xy - radii < xy.new_tensor(size))).all(-1)
        empty = radii.new_zeros(len(centers), 2)
        found.append(empty.index_copy(0, rows, radii * touching[:, None]))
    return torch.stack(found).unflatten(0, means2d.shape[:-2])


def _centers(image: Prepared | Splats, count: int) -> Float[Tensor, "N 2"]:
    """Positions on the picture by row, pixels; 0 for what is not in sight."""
    if isinstance(image, Prepared):
        assert image.centers is not None, "the request is linear"
        return image.centers
    xy = image.projected.xy
    return xy.new_zeros(count, 2).index_copy(0, image.rows, xy)


def _picture(
    cloud: Cloud,
    request: Request,
    image: Prepared | Splats,
    centers: Float[Tensor, "N 2"],
    *,
    color: bool,
) -> tuple[Blended, int]:
    """Blend the Gaussians of an image, at these positions; and the side of the tiles, pixels."""
    camera, box, numerics, execution, depth, *_ = vars(request).values()
    if isinstance(image, Splats):
        xy = centers.index_select(0, image.rows)
        moved = replace(image, projected=replace(image.projected, xy=xy))
        features = features_of(cloud, moved, camera, color=color, depth=depth)
        return splat(moved, features, box, numerics, execution=execution)
    unknown = color and cloud.color.ndim == 2
    features = colors_of(cloud, image.listed.rows, camera) if unknown else None
    return image.picture(centers, features), image.listed.bins.size


def _composed(
    pictures: Sequence[Blended], render_mode: RenderMode, backgrounds: Float[Tensor, "i d"] | None
) -> tuple[Float[Tensor, "i h w x"], Float[Tensor, "i h w 1"]]:
    """Colors over their backgrounds, then depth; and alphas, of all images."""
    color = _stacked([one.features for one in pictures])
    transmittance = _stacked([one.transmittance for one in pictures])[..., None]
    alphas, depths = 1 - transmittance, []
    if _has_depth(render_mode):
        color, depth = color.tensor_split((-1,), -1)
        depths = [depth / alphas.clamp_min(LEAST_ALPHA) if "ED" in render_mode else depth]
    if backgrounds is not None and color.shape[-1]:
        color = color + transmittance * backgrounds.to(color)[:, None, None]
    return torch.cat((color, *depths), -1) if depths else color, alphas


def _stacked(images: list[Tensor]) -> Tensor:
    """Tensors of all images; one alone is not copied."""
    return images[0][None] if len(images) == 1 else torch.stack(images)


def _has_depth(render_mode: RenderMode) -> bool:
    """Whether depth is a channel: in every mode but RGB."""
    return "D" in render_mode.replace("RGB", "")
