"""Gaussians of a scene with what tells one object from another: normals, heights, neighbors, and
values smoothed over the graph of neighbors.

`n` Gaussians; world units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, radians

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int, Int64, Shaped
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import cg
from torch import Tensor

from gsedit.scene.cache import cached_per_scene
from gsedit.scene.merging import MAX_GAUSSIANS, MergedScene, coarsen
from gsedit.scene.neighbors import k_nearest
from gsedit.views.around import cameras_of
from gsedit.views.dataset import evenly_spaced
from gsedit.views.normals import estimate_normals
from gsedit.views.place import Place, place_of
from rasterizer.camera import Camera
from rasterizer.numerics import sh_to_color
from rasterizer.render import contributions
from rasterizer.scene import Gaussians, concatenate

VIEWS = 8
"""Most views that the surfaces are looked at from."""
VIEW_PIXELS = 192
"""Longer side of their pictures."""
SOLID_OPACITY = 0.1
"""Gaussians fainter than this connect nothing."""
GROUPS = MAX_GAUSSIANS - 40_000, 40_000
"""Most groups of a large scene that are near the place, and that are beyond it."""
LARGE = 6.0
"""Gaussians this many times as long as is usual connect nothing: haze and sky."""

NEIGHBOR_COUNT = 8
"""Nearest neighbors of a Gaussian in the graph."""
SURFACE_COLOR_RMS = 0.1
"""Difference of two colors (RMS over channels) at which neighbors count as of two surfaces."""
SURFACE_ANGLE = 45.0
"""Degrees between the normals of two neighbors at which they count as of two surfaces."""


Near = tuple[Float64[np.ndarray, "n k"], Int64[np.ndarray, "n k"]]
"""Distances to the nearest of each Gaussian, nearest first, and their rows."""


def nearest_of(scene: Gaussians) -> Near:
    """The NEIGHBOR_COUNT nearest of each Gaussian, or all others where there are fewer."""
    points = scene.means.detach().double().numpy()
    distance, rows = k_nearest(points, points, min(NEIGHBOR_COUNT + 1, max(len(points), 1)))
    return distance[:, 1:], rows[:, 1:]  # the first is the point itself


def neighbors(
    scene: Gaussians, normals: Float[Tensor, "n 3"] | None = None, near: Near | None = None
) -> csr_matrix:
    """The graph of a scene, n x n and symmetric: how alike nearest neighbors are, from 0 for no
    neighbors to 1 for two of one color. Colors are those without view dependence.

    With unit normals, two that face apart by SURFACE_ANGLE are as unlike as two colors of two
    surfaces. `near` are the nearest of each (`nearest_of`), where they are known.
    """
    n = len(scene)
    if n < 2:
        return csr_matrix((n, n))
    distance, index = nearest_of(scene) if near is None else near
    typical = np.maximum(np.median(distance, axis=1), 1e-12)
    colors = sh_to_color(scene.sh[:, 0].detach().double()).clamp(0, 1).numpy()
    facing = None if normals is None else normals.detach().double().numpy()
    alike = np.empty(index.shape)
    for j, near_by in enumerate(index.T):  # all at once would be 24 numbers each in double
        unlike = np.square(colors - colors[near_by]).mean(1) / (2 * SURFACE_COLOR_RMS**2)
        if facing is not None:
            cosine = (facing * facing[near_by]).sum(1).clip(-1, 1)
            unlike += (1 - cosine) / (1 - cos(radians(SURFACE_ANGLE))) / 2
        close = distance[:, j] <= 3.0 * np.sqrt(typical * typical[near_by])
        alike[:, j] = np.exp(-unlike) * close
    starts = np.arange(n + 1) * index.shape[1]
    matrix = csr_matrix((alike.reshape(-1), index.reshape(-1), starts), shape=(n, n))
    return matrix.maximum(matrix.T).tocsr()


def smooth(
    values: Float[Tensor, " n"],
    confidence: Float[Tensor, " n"],
    graph: csr_matrix,
    strength: float,
    tolerance: float = 1e-2,  # values are compared with thresholds, not read
) -> Float[Tensor, " n"]:
    """Values that are near the given ones where these are sure, and near their neighbors'.

    They minimise sum c_i (x_i - v_i)^2 + strength / 2 sum a_ij (x_i - x_j)^2, with confidences c
    and affinities a: the random walker with priors (Grady 2005). A Gaussian without confidence
    takes the mean of its neighbors. `tolerance` is the relative residual: less is needed where few
    are sure, and most follow them from afar.
    """
    c = confidence.double().numpy() + 1e-6
    degree = np.asarray(graph.sum(1)).squeeze(1)
    system = diags(c) + strength * (diags(degree).tocsr() - graph)
    given = values.double().numpy()
    preconditioner = diags(1 / system.diagonal())
    solved, _ = cg(system, c * given, x0=given, rtol=tolerance, maxiter=200, M=preconditioner)
    return torch.from_numpy(solved).to(values)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The Gaussians of a scene as pieces of surfaces."""

    scene: Gaussians
    place: Place
    """Upright axes, and the middle of what the cameras look at."""
    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    """Unit vectors that point outward."""
    colors: Float64[np.ndarray, "n 3"]
    """sRGB in [0, 1], without view dependence."""
    seen: Float64[np.ndarray, " n"]
    """Pixels that the Gaussian gives, over all looked-at views."""
    solid: Bool[np.ndarray, " n"]
    """Whether it is opaque and small enough to connect others."""
    graph: csr_matrix
    view: int = 0
    """Index of the camera that looks most along the place's front."""
    merged: MergedScene | None = None
    """The large scene whose groups these Gaussians are; None where they are the scene's own."""

    def __len__(self) -> int:
        return len(self.points)

    def expanded(self, values: Shaped[Tensor, " n"]) -> Shaped[Tensor, " m"]:
        """Values of the groups of a large scene as values of its `m` Gaussians."""
        return values if self.merged is None else values[self.merged.group.long()]

    def gathered(self, inside: Bool[Tensor, " m"]) -> Bool[np.ndarray, " n"]:
        """Flags of the Gaussians of a large scene as flags of its groups: those of most of each."""
        if self.merged is None:
            return inside.numpy()
        group, count = self.merged.group.long(), len(self)
        share = torch.bincount(group, inside.double(), count) / torch.bincount(
            group, minlength=count
        )
        return (share > 0.5).numpy()

    @cached_property
    def up(self) -> Float64[np.ndarray, "3"]:
        """Unit vector that points upward."""
        return self.place.up.numpy()

    @cached_property
    def heights(self) -> Float64[np.ndarray, " n"]:
        """Heights of the centers along `up`, from the world's origin."""
        return self.points @ self.up

    @cached_property
    def upright(self) -> Float64[np.ndarray, " n"]:
        """Cosine between normal and up: 1 on level ground."""
        return self.normals @ self.up

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of neighbors that are both solid, the lower row first."""
        upper = coo_matrix(self.graph)
        keep = (upper.row < upper.col) & self.solid[upper.row] & self.solid[upper.col]
        return np.stack((upper.row[keep], upper.col[keep]), 1).astype(np.int64)

    @cached_property
    def alike(self) -> Float64[np.ndarray, " e"]:
        """Affinity of each of the edges, in [0, 1]."""
        pairs = self.edges
        return np.asarray(self.graph[pairs[:, 0], pairs[:, 1]]).reshape(-1)

    @cached_property
    def areas(self) -> Float64[np.ndarray, " n"]:
        """Share of a surface that a Gaussian stands for: the square of its neighbors' distance."""
        pairs = self.edges
        square = np.square(self.points[pairs[:, 0]] - self.points[pairs[:, 1]]).sum(1)
        square = np.concatenate((square, square))
        total = np.bincount(pairs.T.reshape(-1), square, len(self))
        count = np.bincount(pairs.T.reshape(-1), minlength=len(self))
        return total / np.maximum(count, 1)

    def touches(
        self, inside: Bool[np.ndarray, " n"], others: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """How many neighbors each Gaussian inside has among others, both solid."""
        both = np.concatenate((self.edges, self.edges[:, ::-1]))
        first, second = both.T
        return np.bincount(first[inside[first] & others[second]], minlength=len(self))

    def spread(
        self,
        values: Shaped[np.ndarray, " n"],
        known: Bool[np.ndarray, " n"],
        others: Bool[np.ndarray, " n"],
    ) -> Shaped[np.ndarray, " n"]:
        """The values, with those of the others from the nearest known one."""
        out, rows, asked = values.copy(), np.flatnonzero(known), np.flatnonzero(others)
        if len(rows) and len(asked):
            _, at = k_nearest(self.points[rows], self.points[asked], 1)
            out[asked] = values[rows[at[:, 0]]]
        return out


@cached_per_scene
@torch.no_grad()
def look(
    scene: Gaussians, cameras: Sequence[Camera] = (), groups: tuple[int, int] = GROUPS
) -> Surfaces:
    """Look at a scene's surfaces from at most VIEWS of the cameras; found ones where none are.

    A larger scene than its most `groups` is looked at by these. Raises UsageError for an empty one.
    """
    some = cameras_of(scene, cameras, VIEWS, VIEW_PIXELS)
    chosen = [some[i].fitted(VIEW_PIXELS) for i in evenly_spaced(len(some), VIEWS)]
    seen = torch.zeros(len(scene))
    for camera in chosen:
        seen += contributions(scene, camera)
    place = place_of(scene, some, seen)
    merged = _grouped(scene, place, groups)
    if merged is not None:
        scene = merged.scene
        seen = torch.zeros(len(scene)).index_add_(0, merged.group, seen)
    near = nearest_of(scene)
    normals = estimate_normals(scene, chosen, near=torch.from_numpy(near[1])).directions
    longest = scene.scales.amax(1)
    solid = (scene.opacities > SOLID_OPACITY) & (longest < LARGE * longest[seen > 0].median())
    ahead = torch.stack([camera.forward.double() for camera in some])
    return Surfaces(
        scene,
        place,
        scene.means.double().numpy(),
        normals.double().numpy(),
        sh_to_color(scene.sh[:, 0].double()).clamp(0, 1).numpy(),
        seen.double().numpy(),
        solid.numpy(),
        neighbors(scene, normals, near),
        int((ahead @ -place.front).argmax()),
        merged,
    )


def looking_at(
    point: Float[Tensor, "3"], camera: Camera, cameras: Sequence[Camera]
) -> tuple[int, ...]:
    """Indices of the cameras that have a point in their pictures and are not much farther from it
    than `camera`; all where none is."""
    reach = 2.0 * (camera.center.double() - point).norm()

    def looks(each: Camera) -> bool:
        near = (each.center.double() - point).norm() <= reach
        return bool(near and each.pictured(point)[2])

    return tuple(i for i, each in enumerate(cameras) if looks(each)) or tuple(range(len(cameras)))


def _grouped(scene: Gaussians, place: Place, most: tuple[int, int]) -> MergedScene | None:
    """The groups of a large scene, few of them beyond the place; None for one that is not large."""
    if len(scene) <= sum(most):
        return None
    plain = replace(scene, sh=scene.sh[:, :1])
    near = (scene.means.double() - place.center).norm(dim=1) < place.radius
    group, scenes, before = torch.empty(len(scene), dtype=torch.int32), [], 0
    for part, count in zip((near, ~near), most):
        own = plain[part]
        merged = coarsen(own, count)
        scenes.append(own if merged is None else merged.scene)
        own_group = torch.arange(len(own)) if merged is None else merged.group
        group[part] = own_group.int() + before
        before += len(scenes[-1])
    return MergedScene(concatenate(*scenes), group, scene)
