"""A mesh of a scene: what views see, fused, tidied and colored.

Depth maps are fused into signed distances on a sparse grid (Curless and Levoy 1996, by Open3D's
voxel blocks): each view adds the distance along its rays, cut at a few voxels, also what it sees to
be free. So what only some views see in the air, others remove. A solid is closed by its boundary
through the surface, drawn anew on a grid. Marching cubes give each edge to two faces whatever the
distances are; a decimation would not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, log2, sqrt
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int, Int64
from scipy.ndimage import label
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.mesh.triangles import Mesh, from_open3d, to_open3d
from gsedit.pictures.viewer.libraries import import_open3d, import_pyvista
from gsedit.scene.neighbors import k_nearest
from gsedit.views.around import FOUND_SIZE_PIXELS, find_viewpoints
from gsedit.views.dataset import evenly_spaced
from gsedit.views.depth import SeenSurface, seen_surface
from gsedit.views.paths import common_point
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

CUT_VOXELS = 6.0
"""Distance, in voxels, at which distances are cut: 2.7 standard deviations of a Gaussian, beyond
the noise of depth in 99 % of pixels."""
BLOCK = 8
"""Voxels, and points, along a side of a block: what has no surface is not measured point by point.
"""
MOST_BLOCKS = 60_000
"""Blocks of the grid: 250 MB, and 2.5 million triangles. A grid of more is made coarser."""
CLEAR = 0.1
"""Opacity below which a pixel tells that its ray meets nothing."""


@dataclass(frozen=True, eq=False)
class Ball:
    """Part of the world that a mesh is made of."""

    center: Float[Tensor, "3"]
    radius: float
    usual: float = 0.0
    """Standard deviation of a Gaussian up to which it is no haze, however small the ball is."""

    def holds(
        self, points: Float[Tensor, "*b 3"], spread: Float[Tensor, "*b"]
    ) -> Bool[Tensor, "*b"]:
        """Whether points on Gaussians of these standard deviations are of a surface inside."""
        near = (points - self.center).norm(dim=-1) < self.radius
        return near & (spread < max(0.05 * self.radius, self.usual))


def fuse(surfaces: Sequence[SeenSurface], ball: Ball, voxel: float) -> tuple[Mesh, float]:
    """(the surface inside a ball, the voxels' side): `voxel`, or more where memory asks for it."""
    # a pixel without a surface lies behind all of the grid
    far = 4.0 * max(float(s.depth.max()) for s in surfaces) + ball.radius
    while True:
        grid = _grid(voxel)
        touched = [_touched(grid, _Frame.of(surface, ball, far), far) for surface in surfaces]
        blocks = np.unique(np.concatenate(touched), axis=0)
        if len(blocks) <= MOST_BLOCKS:
            break
        voxel *= 1.02 * sqrt(len(blocks) / MOST_BLOCKS)  # a surface has a square of them
    if not len(blocks):
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), voxel
    whole = _tensor(blocks, np.int32)
    for surface in surfaces:  # one at a time: they take the memory of the depths again, twice
        frame = _Frame.of(surface, ball, far)
        grid.integrate(whole, frame.free, frame.lens, frame.pose, 1.0, far, CUT_VOXELS)
    views = min(3, len(surfaces))  # two agree by chance
    found = from_open3d(grid.extract_triangle_mesh(views - 0.5).to_legacy())
    return Mesh(found.vertices + ball.center.numpy(), found.faces), voxel


@dataclass(frozen=True, eq=False)
class _Frame:
    """A view as Open3D takes it, around the ball's center."""

    inside: Any
    """Depth of what is inside the ball; 0 elsewhere."""
    free: Any
    """Depth of all, and `far` where the ray meets nothing."""
    lens: Any
    pose: Any

    @classmethod
    def of(cls, surface: SeenSurface, ball: Ball, far: float) -> _Frame:
        camera, depth = surface.camera, surface.depth
        inside = depth * (ball.holds(surface.points, surface.spread) & surface.seen)
        clear = ~surface.seen & (surface.alpha < CLEAR)
        free = depth.masked_fill(clear, 0.99 * far)
        lens = [[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]]
        pose = camera.world_to_camera.detach().double().clone()
        pose[:3, 3] += pose[:3, :3] @ ball.center
        return cls(
            _image(inside), _image(free), _tensor(np.array(lens), np.float64),
            _tensor(pose.numpy(), np.float64),
        )  # fmt: skip


def _touched(grid: Any, frame: _Frame, far: float) -> Int[np.ndarray, "b 3"]:
    """The blocks near the surface that a view sees."""
    try:
        return grid.compute_unique_block_coordinates(
            frame.inside, frame.lens, frame.pose, 1.0, far, CUT_VOXELS
        ).numpy()
    except RuntimeError as error:
        if "No block is touched" not in str(error):  # one pixel in 16 is looked at
            raise
        return np.zeros((0, 3), np.int32)


def _grid(voxel: float) -> Any:
    open3d = import_open3d()
    kinds = (open3d.core.float32,) * 2
    return open3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), kinds, ((1), (1)), voxel, BLOCK, MOST_BLOCKS
    )


def _image(values: Float[Tensor, "h w"]) -> Any:
    return import_open3d().t.geometry.Image(_tensor(values.float().numpy(), np.float32))


def _tensor(values: np.ndarray, kind: type) -> Any:
    return import_open3d().core.Tensor(np.ascontiguousarray(values, kind))


FACES_PER_SQUARE = 3.2
"""Triangles of marching cubes for a square of the grid's side of surface; 2 of a flat one."""
Signed = Callable[[Float64[np.ndarray, "p 3"]], Float32[np.ndarray, " p"]]
"""A map from points to their signed distances from a surface."""


def closed(mesh: Mesh, voxel: float, faces: int) -> Mesh:
    """A closed surface near a mesh, of at most `faces` faces, no finer than the voxels.

    A screened Poisson reconstruction (Kazhdan 2013) spans what nobody saw; where it leaves its box
    it is cut and capped.
    """
    solid = _solid(mesh, voxel)
    side = max(voxel, sqrt(FACES_PER_SQUARE * float(solid.areas.sum()) / faces))
    while True:
        found = _boundary(solid, mesh, side)
        if len(found.faces) <= faces:
            return found
        side *= 1.02 * sqrt(len(found.faces) / faces)


def _solid(mesh: Mesh, voxel: float) -> Mesh:
    """The reconstructed surface, open at its box where the mesh goes on to there."""
    open3d = import_open3d()
    vectors = open3d.utility.Vector3dVector
    cloud = open3d.geometry.PointCloud(vectors(mesh.vertices))
    cloud.normals = vectors(mesh.normals)
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    depth = min(10, max(5, ceil(log2(1.1 * extent / voxel))))
    found, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
    return from_open3d(found)


def _boundary(solid: Mesh, mesh: Mesh, side: float) -> Mesh:
    """The boundary of what is behind the solid's surface, in the mesh's box, with a margin."""
    low, high = mesh.vertices.min(0) - 2 * side, mesh.vertices.max(0) + 2 * side
    side = max(side, float(np.prod(high - low) / 30_000_000) ** (1 / 3))  # 120 MB of distances
    blocks = np.ceil((high - low) / (side * BLOCK)).astype(int)
    distances = _distances(_signed(solid), low, side, blocks)
    for axis in range(3):  # outside of the box nothing is solid
        np.moveaxis(distances, axis, 0)[[0, -1]] = side
    grid = import_pyvista().ImageData(
        dimensions=distances.shape, spacing=(side,) * 3, origin=tuple(low)
    )
    cut = grid.contour([0.0], scalars=distances.ravel(order="F"), method="marching_cubes")
    faces = np.asarray(cut.faces, np.int64).reshape(-1, 4)[:, 1:]
    found = Mesh(np.asarray(cut.points, np.float64), faces)
    return found if found.volume >= 0 else Mesh(found.vertices, faces[:, ::-1])


def _distances(
    signed: Signed, low: Float64[np.ndarray, "3"], side: float, blocks: Int64[np.ndarray, "3"]
) -> Float32[np.ndarray, "x y z"]:
    """Signed distances on a grid from `low`; exact near the surface, of the right sign elsewhere,
    and never 0."""
    corners = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), -1).reshape(-1, 3)
    middles = signed(low + side * (BLOCK * corners + (BLOCK - 1) / 2))
    result = np.repeat(middles[:, None], BLOCK**3, 1)
    near = np.flatnonzero(np.abs(middles) < sqrt(3) * BLOCK * side)
    inner = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for some in np.array_split(near, max(1, len(near) * BLOCK**3 // (1 << 20))):  # points at once
        points = low + side * (BLOCK * corners[some, None] + inner)
        result[some] = signed(points.reshape(-1, 3)).reshape(-1, BLOCK**3)
    result[np.abs(result) < 1e-4 * side] = 1e-4 * side  # a corner on the surface: flat triangles
    cube = result.reshape(*blocks, BLOCK, BLOCK, BLOCK)
    return cube.transpose(0, 3, 1, 4, 2, 5).reshape(blocks * BLOCK)


def _signed(mesh: Mesh) -> Signed:
    """Signed distances from a surface, negative behind it: by the normal where it is nearest."""
    open3d, normals = import_open3d(), mesh.normals
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(to_open3d(mesh)))

    def distances(points: Float64[np.ndarray, "p 3"]) -> Float32[np.ndarray, " p"]:
        places = points.astype(np.float32)
        found = scene.compute_closest_points(open3d.core.Tensor(places))
        away = places - found["points"].numpy()
        corners = mesh.faces[found["primitive_ids"].numpy().astype(np.int64)]
        uv = found["primitive_uvs"].numpy()
        weights = np.column_stack((1 - uv.sum(1), uv))
        facing = (normals[corners] * weights[:, :, None]).sum(1)
        behind = (away * facing).sum(1) < 0
        return (np.linalg.norm(away, axis=1) * np.where(behind, -1, 1)).astype(np.float32)

    return distances


def without_crumbs(mesh: Mesh) -> Mesh:
    """The mesh without the parts that are small beside its largest one."""
    if not len(mesh.faces):
        return mesh
    part = mesh.components
    area = np.bincount(part, mesh.areas)
    return mesh.kept(area[part] >= 0.01 * area.max())  # smaller ones are floaters


def smoothed(mesh: Mesh) -> Mesh:
    """The mesh after Taubin's smoothing (1995)."""
    return from_open3d(to_open3d(mesh).filter_smooth_taubin(5))


def decimated(mesh: Mesh, faces: int) -> Mesh:
    """The mesh with at most `faces` faces, by quadric errors (Garland and Heckbert 1997)."""
    if len(mesh.faces) <= faces:
        return mesh
    return from_open3d(to_open3d(mesh).simplify_quadric_decimation(faces))


LEAST = 0.05
"""Share of the pixels from which what is behind a scene may be a backdrop."""
EVEN, ALIKE = 0.9, 0.04
"""Share of what is behind that has the backdrop's color, and the largest difference of a channel,
ten levels of 256: fits of even backdrops stay below a fourth of it."""


def backdrop_color(surfaces: Sequence[SeenSurface], ball: Ball) -> Float[Tensor, "3"] | None:
    """The one color, in [0, 1], of all that is seen outside of the ball; None where it has several,
    or is hardly seen."""
    behind = [s.seen & ~ball.holds(s.points, s.spread) for s in surfaces]
    colors = torch.cat([_shown(s)[some] for s, some in zip(surfaces, behind)])
    if len(colors) < max(1.0, LEAST * sum(s.depth.numel() for s in surfaces)):
        return None
    color = colors.median(0).values
    even = _alike(colors, color).double().mean()
    return color if float(even) >= EVEN else None


def before_backdrop(surface: SeenSurface, color: Float[Tensor, "3"], ball: Ball) -> SeenSurface:
    """The surface without the backdrop, of whose rays nothing is known then: all that has its color
    and goes on to what is behind the ball."""
    alike = _alike(_shown(surface), color) & surface.seen
    behind = alike & ~ball.holds(surface.points, surface.spread)
    parts = np.zeros(alike.shape, np.int32)
    label(alike.numpy(), output=parts)  # 0 where not alike
    gone = torch.from_numpy(np.isin(parts, np.unique(parts[behind.numpy()])))
    return replace(surface, depth=surface.depth.masked_fill(gone, 0))


def _shown(surface: SeenSurface) -> Float[Tensor, "h w 3"]:
    """Colors without what shines through."""
    return surface.color / surface.alpha[..., None].clamp_min(0.5)


def _alike(colors: Float[Tensor, "*b 3"], color: Float[Tensor, "3"]) -> Bool[Tensor, "*b"]:
    return (colors - color).abs().amax(-1) < ALIKE


VIEWS, FOUND = 64, 36
"""Most views that are fused, and those that are found; more cost time, and agree."""
RINGS = (20.0, 55.0, -25.0)
"""Elevations, degrees, of the views around an object without cameras: it has an underside."""
MOST_PIXELS = 800
"""Longest side of the pictures that are fused."""
FINENESS = 0.45
"""Side of the voxels, in the median standard deviation of the Gaussians that are seen: finer ones
show their noise."""
FEW, COARSE = 0.02, 2.0
"""Share of what is seen below which all seems haze: a scene of few, wide Gaussians. Up to so many
times their median standard deviation they are taken then."""
REACHED, MARGIN = 0.98, 1.1
"""Share of what is seen that a mesh holds, and the radius of its ball against its reach."""


@torch.no_grad()
def mesh(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    *,
    inside: Bool[Tensor, " n"] | None = None,
    faces: int = 200_000,  # what a browser or a game shows at ease
    watertight: bool = False,
) -> Mesh:
    """Make a mesh of at most `faces` triangles of what the cameras look at; found ones without any.

    Of a capture it ends at the cameras' distance from what they look at. `inside` are the Gaussians
    to take, drawn alone. `watertight` closes the surface where nobody saw it, too. Units and axes
    are those of the scene. Raises UsageError where there is no surface.
    """
    if faces < 4:
        raise UsageError(f"a mesh has 4 faces or more, not {faces}")
    if any(camera.model != "pinhole" for camera in cameras):
        raise UsageError("a mesh is made from pinhole cameras: leave the parallel ones out")
    alone = scene if inside is None else scene[inside]
    if not len(alone):
        raise UsageError("nothing is selected: there is no surface to make a mesh of")
    chosen = _views(alone, cameras)
    survey = _survey(alone, chosen, inside is not None)
    ball, voxel = survey.ball, survey.voxel
    views = [each.scaled(min(survey.pixel / voxel, MOST_PIXELS / each.longest)) for each in chosen]
    surfaces = [survey.of(seen_surface(alone, camera)) for camera in views]
    found, voxel = fuse(surfaces, ball, voxel)
    found = without_crumbs(found)
    if not len(found.faces):
        raise UsageError("no surface was found: its Gaussians are too faint, or no view sees it")
    found = smoothed(found)
    found = without_crumbs(closed(found, voxel, faces)) if watertight else decimated(found, faces)
    return replace(found, colors=painted(found, surfaces, voxel))


def _views(scene: Gaussians, cameras: Sequence[Camera]) -> Sequence[Camera]:
    """The views that are fused: some of the cameras, or found ones."""
    if cameras:
        return [cameras[i] for i in evenly_spaced(len(cameras), VIEWS)]
    found = find_viewpoints(scene, FOUND, FOUND_SIZE_PIXELS, rings=RINGS)
    return [each.camera for each in found]


@dataclass(frozen=True, eq=False)
class _Survey:
    """Facts that small pictures tell."""

    ball: Ball
    """Part of the world to make a mesh of."""
    voxel: float
    """Side of the voxels, world units."""
    pixel: float
    """The side of a pixel of the cameras, on the surface."""
    backdrop: Float[Tensor, "3"] | None
    """Its color, where it has one."""

    def of(self, surface: SeenSurface) -> SeenSurface:
        """The surface without the backdrop; its pictures in half precision, for there are many."""
        if self.backdrop is not None:
            surface = before_backdrop(surface, self.backdrop, self.ball)
        return replace(surface, color=surface.color.half(), alpha=surface.alpha.half())


def _survey(scene: Gaussians, cameras: Sequence[Camera], whole: bool) -> _Survey:
    """Survey what is seen: all of it if `whole`, else what the cameras look at."""
    seen = [seen_surface(scene, camera.fitted(192)) for camera in cameras]
    ball = _ball(seen, cameras, whole)
    backdrop = backdrop_color(seen, ball)
    if backdrop is not None:
        rest = [before_backdrop(surface, backdrop, ball) for surface in seen]
        if any(bool(surface.seen.any()) for surface in rest):
            seen, ball = rest, _ball(rest, cameras, whole, usual=torch.inf)
        else:  # all has its color: it tells nothing apart
            backdrop = None
    points, spread, sides = _pixels(seen, cameras)
    held = ball.holds(points, spread)
    if not held.any():
        raise UsageError("the views show haze and no surface: add --region")
    pixel = float(sides[held].median())
    longest = max(camera.longest for camera in cameras)
    voxel = max(FINENESS * float(spread[held].median()), pixel * longest / MOST_PIXELS)
    return _Survey(ball, voxel, pixel, backdrop)


def _pixels(
    seen: Sequence[SeenSurface], cameras: Sequence[Camera]
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, " p"], Float[Tensor, " p"]]:
    """(places, standard deviations of Gaussians, sides of the cameras' pixels) of what is seen."""
    shown = [surface.seen for surface in seen]
    points = torch.cat([surface.points[h] for surface, h in zip(seen, shown)])
    spread = torch.cat([surface.spread[h] for surface, h in zip(seen, shown)])
    sides = [s.depth[h] / c.fx for s, h, c in zip(seen, shown, cameras)]
    if not len(points):
        raise UsageError("the views show no surface: name cameras by --data, or add --region")
    return points, spread, torch.cat(sides)


def _ball(
    seen: Sequence[SeenSurface], cameras: Sequence[Camera], whole: bool, usual: float = 0.0
) -> Ball:
    """The ball that holds nearly all of the surface, or what of it the cameras look at."""
    points, spread, _ = _pixels(seen, cameras)
    target = None if whole else common_point(cameras)
    center = points.median(0).values if target is None else target
    most = torch.inf
    if target is not None:
        eyes = torch.stack([camera.center.detach().double() for camera in cameras])
        most = float((eyes - center).norm(dim=-1).median())
    away = (points - center).norm(dim=-1)
    radius = min(most, float(away.max()) * MARGIN)
    near, first = away < radius, Ball(center, radius, usual)
    if float(first.holds(points, spread).sum()) < FEW * float(near.sum()):
        usual = COARSE * float(spread[near].median())
        first = Ball(center, radius, usual)
    held = away[first.holds(points, spread)].sort().values
    if not len(held):
        return first
    return Ball(center, min(most, MARGIN * float(held[int(REACHED * (len(held) - 1))])), usual)


GREY = 0.5
"""Color of vertices where no view sees any."""


def painted(
    mesh: Mesh, surfaces: Sequence[SeenSurface], voxel: float
) -> Float64[np.ndarray, "v 3"]:
    """Colors of the vertices, sRGB in [0, 1]: means over the views that see them, by how straight
    and near they look. Those that none sees take that of the nearest one that is seen."""
    points, normals = torch.from_numpy(mesh.vertices), torch.from_numpy(mesh.normals)
    total, weight = torch.zeros_like(points), points.new_zeros(len(points))
    for surface in surfaces:
        color, strength = _seen(points, normals, surface, 3.0 * voxel)
        total += strength[:, None] * color
        weight += strength
    seen = (weight > 0).numpy()
    colors = (total / weight.clamp_min(1e-300)[:, None]).clamp(0, 1).numpy()
    if not seen.any():
        return np.full_like(colors, GREY)
    if not seen.all():
        _, near = k_nearest(mesh.vertices[seen], mesh.vertices[~seen], 1)
        colors[~seen] = colors[seen][near[:, 0]]
    return colors


def _seen(
    points: Float[Tensor, "v 3"], normals: Float[Tensor, "v 3"], surface: SeenSurface, behind: float
) -> tuple[Float[Tensor, "v 3"], Float[Tensor, " v"]]:
    """Colors of vertices in a view, and their weights: 0 where it does not see them."""
    camera = surface.camera
    xy, z = camera.project(points)
    size = xy.new_tensor((camera.width, camera.height))
    grid = (2 * xy / size - 1)[None, None].float()
    maps = torch.cat((surface.color, surface.alpha[..., None]), -1).movedim(-1, 0)[None].float()
    color = torch.nn.functional.grid_sample(maps, grid, align_corners=False)[0, :, 0].T.double()
    depth = torch.nn.functional.grid_sample(
        surface.depth[None, None].float(), grid, mode="nearest", align_corners=False
    )[0, 0, 0].double()
    towards = torch.nn.functional.normalize(camera.center.to(points) - points, dim=-1)
    straight = (normals * towards).sum(-1).clamp_min(0)
    inside = (z > 0) & ((xy > 0) & (xy < size)).all(-1) & (depth > 0)
    visible = inside & ((z - depth).abs() < behind)
    strength = visible * straight**4 / z.clamp_min(1e-300).square()  # slanted looks are smeared
    return color[:, :3] / color[:, 3:].clamp_min(0.5), strength
