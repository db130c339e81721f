"""A scene whose pictures, depth, visibility and edited versions are exact: sphere-traced solids.

`h w` pixels, `m` rays. A ray is origin + z * direction with directions of unit depth, so that z is
depth along the view. Float64 throughout; no rasterizer, no graphics driver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from gsedit.bench.synthetic.paint import Paint
from gsedit.bench.synthetic.shapes import Sdf, gradient, length
from rasterizer.camera import Camera

OVERSTEP = 1e-4  # of the scene's radius: a shorter chord may be missed: a silhouette off by 1e-9
STEPS = 400  # to skim a ball of the scene's radius takes 2 sqrt(2 / OVERSTEP) = 280 steps
RAYS = 1 << 15  # points measured at once: their distances stay in a second-level cache


@dataclass(frozen=True, eq=False)
class Traced:
    """Exact maps of a camera's view."""

    image: Float[Tensor, "h w 3"]
    """In [0, 1]; the mean over sub-pixels where the picture is supersampled."""
    alpha: Float[Tensor, "h w"]
    """1 where a solid was hit, 0 where not; the covered share where supersampled."""
    depth: Float[Tensor, "h w"]
    """Along the view at the pixel's center, world units; 0 where nothing was hit."""
    normal: Float[Tensor, "h w 3"]
    """Outward unit normal in the world at the pixel's center; 0 where nothing was hit."""

    @property
    def hit(self) -> Bool[Tensor, "h w"]:
        """Whether the pixel's center sees a solid."""
        return self.depth > 0


@dataclass(frozen=True, eq=False)
class SyntheticScene:
    """Painted solids within a ball around the origin, before a background of one color."""

    name: str
    sdf: Sdf
    """Points `*b 3` -> signed distance `*b`; 1-Lipschitz."""
    albedo: Paint
    """Points `*b 3` -> rgb in [0, 1]: the color from every direction."""
    background: Float[Tensor, "3"]
    radius: float
    """Radius of the ball that holds the scene, world units; whatever reaches out of it is cut off.
    """
    up: Float[Tensor, "3"]

    def trace(self, camera: Camera, supersample: int = 1) -> Traced:
        """The picture (the mean of `supersample`^2 sub-pixels), depth and normals; float64."""
        h, w = camera.height, camera.width
        xy = camera.pixel_centers().reshape(-1, 2)
        depth = self._depth(camera, xy)
        hit = depth.isfinite()
        points = camera.unproject(xy[hit], depth[hit])
        normals = torch.nn.functional.normalize(gradient(self.sdf, points), dim=-1)
        if supersample == 1:
            image, alpha = self._image(points, hit).reshape(h, w, 3), hit.double().reshape(h, w)
        else:
            image, alpha = self._photo(camera, supersample)
        return Traced(
            image=image,
            alpha=alpha,
            depth=depth.masked_fill(~hit, 0).reshape(h, w),
            normal=_scatter(normals, hit).reshape(h, w, 3),
        )

    def visible(self, points: Float[Tensor, "*b 3"], camera: Camera) -> Bool[Tensor, "*b"]:
        """Whether the camera sees these points: in front, in the picture, with nothing between."""
        points = points.to(torch.float64)
        xy, z, visible = camera.pictured(points)
        depth = self._depth(
            camera, xy[visible], limit=z[visible] - 1e-6 * self.radius
        )  # not hidden by itself
        visible[visible.clone()] = depth.isinf()
        return visible

    def _image(self, points: Float[Tensor, "k 3"], hit: Bool[Tensor, " m"]) -> Float[Tensor, "m 3"]:
        """Colors of rays: the albedo where they hit, else the background."""
        image = self.background.to(torch.float64).repeat(len(hit), 1)
        image[hit] = self.albedo(points)
        return image

    def _photo(
        self, camera: Camera, supersample: int
    ) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w"]]:
        """Image and coverage, the mean over `supersample`^2 sub-pixels."""
        fine = camera.resized(camera.width * supersample, camera.height * supersample)
        xy = fine.pixel_centers().reshape(-1, 2)
        depth = self._depth(fine, xy)
        hit = depth.isfinite()
        rgba = torch.cat(
            (self._image(fine.unproject(xy[hit], depth[hit]), hit), hit.double()[:, None]), -1
        )
        blocks = (camera.height, supersample, camera.width, supersample, 4)
        mean = rgba.reshape(blocks).mean((1, 3))
        return mean[..., :3], mean[..., 3]

    def _depth(
        self, camera: Camera, xy: Float[Tensor, "m 2"], limit: Float[Tensor, " m"] | None = None
    ) -> Float[Tensor, " m"]:
        """Depth behind pixel positions, inf where nothing is hit (before `limit`)."""
        origin = camera.center.detach().to(torch.float64)
        ones = torch.ones(len(xy), dtype=torch.float64)
        directions = camera.unproject(xy, ones).detach() - origin
        near, far = _ball(origin, directions, self.radius)
        far = far if limit is None else torch.minimum(far, limit)
        overstep = OVERSTEP * self.radius
        return first_hit(self.sdf, origin, directions, near, far, overstep)


def first_hit(
    sdf: Sdf,
    origin: Float[Tensor, "3"],
    directions: Float[Tensor, "m 3"],
    near: Float[Tensor, " m"],
    far: Float[Tensor, " m"],
    overstep: float,
) -> Float[Tensor, " m"]:
    """The smallest z in [near, far] at which a ray enters the solid; inf if it never does.

    Sphere tracing (Hart 1996) with steps that overshoot by `overstep` world units, so that they end
    on the far side of the surface; then the root within the last step. A ray that starts inside a
    solid hits it there.
    """
    hits = torch.full_like(near, torch.inf)
    rows = (near < far).nonzero().squeeze(-1)
    if not len(rows):
        return hits
    direction = directions[rows].T.contiguous()  # coordinate-major: components are contiguous
    z, end = near[rows], far[rows]
    distance = _along(sdf, origin, direction, z)
    inside = distance <= 0
    hits[rows[inside]] = z[inside]
    keep = ~inside
    brackets = []
    for _ in range(STEPS):
        rows, direction, z, end, distance = _keep(keep, rows, direction, z, end, distance)
        if not len(rows):
            break
        step = (distance + overstep) / length(*direction)
        z_next = torch.minimum(z + step, end)
        distance_next = _along(sdf, origin, direction, z_next)
        crossed = distance_next <= 0
        if crossed.any():
            brackets.append(_keep(crossed, rows, direction, z, distance, z_next, distance_next))
        keep = ~crossed & (z_next < end)
        z, distance = z_next, distance_next
    if brackets:
        rows, direction, *bracket = (torch.cat(column, -1) for column in zip(*brackets))
        hits[rows] = _root(lambda z: _along(sdf, origin, direction, z), *bracket)
    return hits


def _along(
    sdf: Sdf, origin: Float[Tensor, "3"], direction: Float[Tensor, "3 m"], z: Float[Tensor, " m"]
) -> Float[Tensor, " m"]:
    """Signed distances at depth z of rays."""
    rays = zip(direction.split(RAYS, -1), z.split(RAYS))
    return torch.cat([sdf((origin[:, None] + part * d).T) for d, part in rays])


def _keep(
    mask: Bool[Tensor, " m"], *tensors: Shaped[Tensor, "... m"]
) -> tuple[Shaped[Tensor, "... k"], ...]:
    """The columns (last axis) where the mask holds."""
    if mask.all():
        return tensors
    index = mask.nonzero().squeeze(-1)
    return tuple(tensor.index_select(-1, index) for tensor in tensors)


def _root(
    function: Callable[[Float[Tensor, " m"]], Float[Tensor, " m"]],
    a: Float[Tensor, " m"],
    at_a: Float[Tensor, " m"],
    b: Float[Tensor, " m"],
    at_b: Float[Tensor, " m"],
) -> Float[Tensor, " m"]:
    """Roots between a and b by regula falsi in the Illinois form; `at_a` and `at_b` are the
    function's values there, of opposite signs, and `b` is the latest estimate."""
    for _ in range(60):  # regula falsi needs 3 to 6; a crease at worst halves the bracket
        if float(at_b.abs().max()) < 1e-13:  # a few roundings of coordinates of size 1
            break
        rise = at_b - at_a
        c = torch.where(rise == 0, b, b - at_b * (b - a) / rise)
        at_c = function(c)
        opposite = at_c * at_b < 0
        a, at_a = torch.where(opposite, b, a), torch.where(opposite, at_b, at_a / 2)
        b, at_b = c, at_c
    return b


def _ball(
    origin: Float[Tensor, "3"], directions: Float[Tensor, "m 3"], radius: float
) -> tuple[Float[Tensor, " m"], Float[Tensor, " m"]]:
    """Distances at which rays enter (not before 0) and leave a ball around the origin; near > far
    if never."""
    a = (directions * directions).sum(-1)
    middle = -(directions @ origin) / a
    foot = origin + middle[:, None] * directions  # nearest to the center: no cancellation from afar
    square = (radius**2 - (foot * foot).sum(-1)) / a
    half = square.clamp_min(0).sqrt()
    missed = square <= 0
    return (middle - half).clamp_min(0).masked_fill(missed, torch.inf), middle + half


def _scatter(rows: Float[Tensor, "k c"], mask: Bool[Tensor, " m"]) -> Float[Tensor, "m c"]:
    """Rows put back where the mask holds, zeros elsewhere."""
    full = rows.new_zeros((len(mask), rows.shape[-1]))
    full[mask] = rows
    return full
