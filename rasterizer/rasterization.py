"""gsplat's `rasterization` on a CPU: the same arguments by name, the same three results.

Conventions: gsplat 1.5, https://docs.gsplat.studio/main/apis/rasterization.html. `N` Gaussians,
`C` cameras, `D` channels, `K` harmonics, `...` batch dimensions; an image is one camera of one
batch.
"""

from __future__ import annotations

from dataclasses import replace
from math import prod
from typing import Any, Literal, NamedTuple, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rasterizer import checks, harmonics
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, DEFAULT, Execution, Numerics
from rasterizer.project import (
    Projected,
    colors_seen,
    drawn_log_opacities,
    footprint_radii,
    in_sight,
    project_axes,
    project_covariances,
    rotation_matrices,
)
from rasterizer.splat import splat

RenderMode = Literal["RGB", "D", "ED", "RGB+D", "RGB+ED"]

LEAST_BLUR = 1e-10  # square pixels: a line of no width has no picture
LEAST_ALPHA = 1e-10  # gsplat's, in the depth of ED
UPPER = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))  # rows and columns of covars' six numbers
SYMMETRIC = (0, 1, 2, 1, 3, 4, 2, 4, 5)  # and back to 3x3


@torch.autocast("cpu", enabled=False)
def rasterization(
    means: Float[Tensor, "*batch N 3"],
    quats: Float[Tensor, "*batch N 4"] | None,
    scales: Float[Tensor, "*batch N 3"] | None,
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
    covars: Float[Tensor, "..."] | None = None,
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
) -> tuple[Float[Tensor, "*batch C h w X"], Float[Tensor, "*batch C h w 1"], dict[str, Any]]:
    """Render N Gaussians into the images of C cameras, as gsplat does.

    Takes
    - `quats` wxyz, any norm; `scales` standard deviations (not logarithms); `opacities` in [0, 1].
    - `colors`: features [..., (C,) N, D], any D; with `sh_degree` (0 to 4) harmonics
      [..., (C,) N, K, 3], of which the first (sh_degree + 1)^2 are used, and colour + 0.5 is not
      below 0.
    - `covars` [..., N, 3, 3], of which the upper triangle is read, or that triangle [..., N, 6],
      row by row: instead of `quats` and `scales`, which may be None.
    - `viewmats`: rigid, world to camera, OpenCV axes. `Ks`: pixels; skew is not read.
    - `camera_model` "pinhole" or "ortho" (x of a pixel is fx x + cx, at any depth).
    - `near_plane`, `far_plane`: Gaussians with near < z <= far are drawn.
    - `eps2d`: pixel variance added to each projected covariance; at least 1e-10.
    - `radius_clip`: Gaussians whose radii are not above it are not drawn.
    - `rasterize_mode` "antialiased": opacities times sqrt(det(cov) / det(cov + eps2d)).
    - `tile_size`: None chooses one per image, from the footprints. Changes time only.
    - `execution`: how it is computed; `tile_size`, where given, replaces the one in it.
    - `packed`, `channel_chunk`, `segmented`: gsplat's trade of memory for time; nothing here.

    Returns
    - colours [..., C, h, w, X]: X is D, then depth as the last channel with +D (the sum of
      weights times z) or +ED (that over alpha); depth alone for D and ED, which blend no colours.
      `backgrounds` lie behind the colours, 0 behind depth.
    - alphas [..., C, h, w, 1].
    - meta, shaped as with packed=False and zero for what is not drawn: means2d [..., C, N, 2]
      (`.grad` is there after a backward pass), radii [..., C, N, 2] int32 pixels, depths,
      opacities [..., C, N], conics [..., C, N, 3] (xx, xy, yy of the inverse covariance), width,
      height, tile_size, tile_width, tile_height (of the first image), n_batches, n_cameras;
      batch_ids, camera_ids, gaussian_ids are None. gsplat's lists of tiles are not in it.

    Differentiable in all tensors but `Ks` (nor is gsplat's). Float32 or float64, as `means` is.
    The stop differs: gsplat drops what follows, and the Gaussian that crosses, where less than 1e-4
    shows through; here an image is wrong by at most 1e-5 of a colour.

    Raises NotImplementedError, naming it, for an option of gsplat's that is not here, and
    ValueError for shapes that do not fit together, and for NaN or infinity in an input, with its
    name and the first row (of colors: of those in sight).
    """
    _refuse_what_is_not_here(
        sparse_grad=sparse_grad,
        absgrad=absgrad,
        distributed=distributed,
        with_ut=with_ut,
        with_eval3d=with_eval3d,
        radial_coeffs=radial_coeffs,
        tangential_coeffs=tangential_coeffs,
        thin_prism_coeffs=thin_prism_coeffs,
        ftheta_coeffs=ftheta_coeffs,
        viewmats_rs=viewmats_rs,
        rolling_shutter=getattr(rolling_shutter, "name", rolling_shutter) not in (None, "GLOBAL"),
    )
    if camera_model not in ("pinhole", "ortho"):
        raise NotImplementedError(f"camera_model={camera_model!r}: pinhole and ortho are here")
    for name, value, known in (
        ("render_mode", render_mode, get_args(RenderMode)),
        ("rasterize_mode", rasterize_mode, ("classic", "antialiased")),
    ):
        if value not in known:
            raise ValueError(f"{name} {value!r} is none of {', '.join(known)}")
    batch, count, views = means.shape[:-2], means.shape[-2], viewmats.shape[-3]
    leading, images = (*batch, views), prod(batch) * views
    if not images:
        raise ValueError("there is no camera: viewmats, or a batch dimension, is empty")
    clouds = _clouds(means, quats, scales, opacities, covars)
    paints = _paints(colors, leading, count, sh_degree)
    plain = Camera(torch.eye(4), 1.0, 1.0, 0.0, 0.0, width, height)
    plain = replace(plain, model="ortho" if camera_model == "ortho" else "pinhole")
    cameras = _cameras(plain, viewmats, Ks, leading)
    if backgrounds is not None:
        checks.all_finite("backgrounds", backgrounds)
        _expect("backgrounds", backgrounds, (*leading, colors.shape[-1]))
    numerics = Numerics(
        blur=max(eps2d, LEAST_BLUR),
        antialiased=rasterize_mode == "antialiased",
        near=near_plane,
        far=far_plane,
        radius_clip=radius_clip,
    )
    checks.settings(numerics)
    execution = execution or AUTO
    if tile_size is not None:
        execution = replace(execution, tile_size=tile_size)

    seen = [_see(clouds[i // views], camera, numerics) for i, camera in enumerate(cameras)]
    meta = _meta(seen, leading, count, width, height)
    centres = meta["means2d"].reshape(images, count, 2)
    drawn = []
    for i, (camera, one) in enumerate(zip(cameras, seen)):
        features = []
        if "RGB" in render_mode:
            means_seen = clouds[i // views].means[one.rows]
            features.append(_colors(paints[i], one.rows, means_seen, camera, sh_degree))
        if "D" in render_mode.replace("RGB", ""):
            features.append(one.projected.depth[:, None])
        drawn.append(
            splat(
                # by way of meta["means2d"], which so gets its gradient
                replace(one.projected, xy=centres[i][one.rows]),
                one.log_opacities,
                torch.cat(features, -1),
                (0, 0, width, height),
                numerics,
                execution=execution,
            )
        )
    size = drawn[0].tile_size
    meta |= {"tile_size": size, "tile_width": -(-width // size), "tile_height": -(-height // size)}
    picture = torch.stack([d.features for d in drawn])
    through = torch.stack([d.transmittance for d in drawn])[..., None]
    alphas = 1 - through
    channels = colors.shape[-1] if "RGB" in render_mode else 0
    color, depth = picture[..., :channels], picture[..., channels:]
    if "ED" in render_mode:
        depth = depth / alphas.clamp_min(LEAST_ALPHA)
    if backgrounds is not None and channels:
        color = color + through * backgrounds.to(color).reshape(images, 1, 1, channels)
    picture = torch.cat((color, depth), -1)
    return picture.unflatten(0, leading), alphas.unflatten(0, leading), meta


def _refuse_what_is_not_here(**options: Any) -> None:
    """Options that gsplat has and this has not: each is off as None or False."""
    for name, value in options.items():
        if value is not None and value is not False:
            raise NotImplementedError(f"{name}={value!r} is not implemented on a CPU")


def _expect(name: str, tensor: Tensor, shape: tuple[int, ...]) -> Tensor:
    if tuple(tensor.shape) != shape:
        found, fitting = list(tensor.shape), list(shape)
        raise ValueError(f"{name} has shape {found}; {fitting} would fit means and viewmats")
    return tensor


def _cameras(plain: Camera, viewmats: Tensor, Ks: Tensor, leading: tuple[int, ...]) -> list[Camera]:
    """`plain` at every pose, with its intrinsics."""
    checks.all_finite("viewmats", _expect("viewmats", viewmats, (*leading, 4, 4)))
    checks.all_finite("Ks", _expect("Ks", Ks, (*leading, 3, 3)))
    poses, intrinsics = viewmats.reshape(-1, 4, 4), Ks.reshape(-1, 3, 3).tolist()
    cameras = [
        replace(plain, world_to_camera=pose, fx=k[0][0], fy=k[1][1], cx=k[0][2], cy=k[1][2])
        for pose, k in zip(poses, intrinsics)
    ]
    for camera in cameras:
        checks.camera(camera)
    return cameras


class _Cloud(NamedTuple):
    """The Gaussians of one batch: of covariance A A^T by quats and scales, or of a given one."""

    means: Float[Tensor, "n 3"]
    opacities: Float[Tensor, " n"]
    quats: Float[Tensor, "n 4"] | None
    scales: Float[Tensor, "n 3"] | None
    covars: Float[Tensor, "n 3 3"] | None

    def extents(self) -> Float[Tensor, " n"]:
        """At least the largest standard deviation of each."""
        if self.scales is not None:
            return self.scales.detach().abs().amax(-1)
        assert self.covars is not None
        return self.covars.detach().diagonal(dim1=-2, dim2=-1).sum(-1).clamp_min(0).sqrt()

    def project(self, rows: Int[Tensor, " m"], camera: Camera, numerics: Numerics) -> Projected:
        means = self.means[rows]
        if self.covars is not None:
            return project_covariances(means, self.covars[rows], camera, numerics)
        assert self.quats is not None
        assert self.scales is not None
        axes = rotation_matrices(self.quats[rows]) * self.scales[rows][:, None, :]
        return project_axes(means, axes, camera, numerics)


def _clouds(
    means: Tensor,
    quats: Tensor | None,
    scales: Tensor | None,
    opacities: Tensor,
    covars: Tensor | None,
) -> list[_Cloud]:
    """The Gaussians of each batch. Where covars are given, quats and scales are not looked at."""
    rows = tuple(means.shape[:-1])
    if covars is not None:
        quats = scales = None
        if covars.dim() == means.dim() + 1:
            covars = _expect("covars", covars, (*rows, 3, 3))[..., UPPER[0], UPPER[1]]
        covars = _expect("covars", covars, (*rows, 6))[..., SYMMETRIC].unflatten(-1, (3, 3))
    elif quats is None or scales is None:
        raise ValueError("quats and scales may be None only where covars are given")
    batches, count = prod(rows[:-1]), rows[-1]

    def split(name: str, field: Tensor, *columns: int) -> list[Tensor]:
        checks.finite(name, field)
        return list(_expect(name, field, (*rows, *columns)).reshape(batches, count, *columns))

    nothing = [None] * batches
    fields = (
        split("means", means, 3),
        split("opacities", opacities),
        nothing if quats is None else split("quats", quats, 4),
        nothing if scales is None else split("scales", scales, 3),
        nothing if covars is None else split("covars", covars, 3, 3),
    )
    return [_Cloud(*one) for one in zip(*fields)]


def _paints(
    colors: Tensor, leading: tuple[int, ...], count: int, sh_degree: int | None
) -> list[Tensor]:
    """Each image's features [N, D], or harmonics [N, K, 3] without the bands that are not used."""
    tail = 1 if sh_degree is None else 2
    shared = colors.dim() == len(leading) + tail  # by the cameras of a batch
    used = (*leading[:-1], count) if shared else (*leading, count)
    if sh_degree is not None:
        bands = (sh_degree + 1) ** 2
        if colors.dim() < 2 or colors.shape[-2] < bands:
            raise ValueError(f"colors has shape {list(colors.shape)}; degree {sh_degree} takes at "
                             f"least {bands} coefficients of 3")  # fmt: skip
        _expect("colors", colors, (*used, colors.shape[-2], 3))
        colors = colors[..., :bands, :]
    else:
        _expect("colors", colors, (*used, colors.shape[-1]))
    images = list(colors.reshape(prod(used[:-1]), *colors.shape[-tail - 1 :]))
    if sh_degree is not None:
        images = [harmonics.without_zeros(image) for image in images]
    return [image for image in images for _ in range(leading[-1] if shared else 1)]


def _colors(
    paint: Tensor,
    rows: Int[Tensor, " m"],
    means: Float[Tensor, "m 3"],
    camera: Camera,
    sh_degree: int | None,
) -> Float[Tensor, "m d"]:
    """Of the rows in sight, whose centres are `means`."""
    paint = paint[rows].to(means)
    checks.finite("colors", paint, rows)
    if sh_degree is None:
        return paint
    colors = colors_seen(paint, means, camera)
    checks.finite("colors", colors, rows)  # sums of finite numbers may overflow
    return colors


class _Seen(NamedTuple):
    """The Gaussians that may show in an image."""

    rows: Int[Tensor, " m"]
    projected: Projected
    opacities: Float[Tensor, " m"]
    """Antialiased where asked for."""
    log_opacities: Float[Tensor, " m"]
    """What is blended: below the floor where radius_clip drops."""


def _see(cloud: _Cloud, camera: Camera, numerics: Numerics) -> _Seen:
    box = (0, 0, camera.width, camera.height)
    rows = in_sight(cloud.means, cloud.extents(), cloud.opacities, camera, box, numerics)
    projected = cloud.project(rows, camera, numerics)
    checks.footprints(projected, rows, ("means", "scales" if cloud.covars is None else "covars"))
    opacities = cloud.opacities[rows].to(cloud.means)  # opacity 0, which has no log, is not seen
    log_opacities = drawn_log_opacities(projected, opacities.log(), numerics)
    if projected.log_gain is not None:
        opacities = opacities * projected.log_gain.exp()
    return _Seen(rows, projected, opacities, log_opacities)


def _meta(
    seen: list[_Seen], leading: tuple[int, ...], count: int, width: int, height: int
) -> dict[str, Any]:
    """What gsplat says of the Gaussians, for all rows; zero for those that are not drawn."""

    def all_rows(values: list[Tensor]) -> Tensor:
        images = [
            value.new_zeros(count, *value.shape[1:]).index_copy(0, one.rows, value)
            for one, value in zip(seen, values)
        ]
        return torch.stack(images).unflatten(0, leading)

    means2d = all_rows([one.projected.xy for one in seen])
    if means2d.requires_grad:
        means2d.retain_grad()
    return {
        "batch_ids": None,
        "camera_ids": None,
        "gaussian_ids": None,
        "radii": all_rows([_radii(one, width, height) for one in seen]),
        "means2d": means2d,
        "depths": all_rows([one.projected.depth for one in seen]),
        "conics": all_rows([_conics(one.projected.whitening) for one in seen]),
        "opacities": all_rows([one.opacities for one in seen]),
        "width": width,
        "height": height,
        "n_batches": prod(leading[:-1]),
        "n_cameras": leading[-1],
    }


def _conics(whitening: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    """W^T W, the inverse covariance: xx, xy, yy."""
    w0, w1, w2 = whitening.unbind(-1)
    return torch.stack((w0 * w0 + w1 * w1, w1 * w2, w2 * w2), -1)


@torch.no_grad()
def _radii(one: _Seen, width: int, height: int) -> Int[Tensor, "m 2"]:
    """Of the footprints that touch the image; 0 for the others."""
    radii = footprint_radii(one.projected, one.log_opacities, DEFAULT)
    size = one.projected.xy.new_tensor((width, height))
    xy = one.projected.xy
    touching = ((xy + radii > 0) & (xy - radii < size)).all(-1, keepdim=True)
    return radii * touching
