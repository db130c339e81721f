"""Selections by a volume that the center of a Gaussian is in; its surface is inside.

Coordinates and lengths are those of the scene's file (see gsedit.scene.table); angles are degrees
about x, then y, then z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import inf, isfinite, isnan
from pathlib import Path
from typing import Any

import numpy as np

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.runs.environment import load_extra
from gsedit.scene.shapes import Bool, Float32
from gsedit.scene.table import SplatTable
from gsedit.scene.volumes import inside_ball, inside_box, squared_norm
from gsedit.select.rules import QUIET, Selection
from gsedit.storage.inputs import existing_file

Vector = tuple[float, float, float]
Points = Float32[np.ndarray, "n 3"]


@dataclass(frozen=True)
class Inside(Selection):
    """Select the centers that a volume holds."""

    holds: Callable[[Points], Bool[np.ndarray, " n"]]

    @QUIET
    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        return self.holds(table.means)


def box(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> Selection:
    """Between two corners, along the axes; `-inf` and `inf` leave a side open."""
    lows, highs = (x0, y0, z0), (x1, y1, z1)
    if any(map(isnan, (*lows, *highs))):
        raise UsageError("box: a corner is not a number")
    for axis, low, high in zip("xyz", lows, highs):
        if low > high:
            raise UsageError(
                f"box: {axis} goes from {low:g} to {high:g}: give the lower corner first"
            )
    return Inside(lambda points: inside_box(points, lows, highs))


def oriented_box(
    x: float, y: float, z: float, a: float, b: float, c: float,
    rx: float = 0.0, ry: float = 0.0, rz: float = 0.0,
) -> Selection:  # fmt: skip
    """About x,y,z, with sides of lengths a, b and c, turned by rx,ry,rz degrees."""
    check_finite("oriented_box", x, y, z, rx, ry, rz)
    check_positive("oriented_box", "side", a, b, c)

    def holds(points: Points) -> Bool[np.ndarray, " n"]:
        half = np.array((a, b, c), np.float32) / 2
        return np.all(np.abs(_along(points, (x, y, z), (rx, ry, rz))) <= half, axis=1)

    return Inside(holds)


def ellipsoid(
    x: float, y: float, z: float, a: float, b: float, c: float,
    rx: float = 0.0, ry: float = 0.0, rz: float = 0.0,
) -> Selection:  # fmt: skip
    """About x,y,z, with radii a, b and c, turned by rx,ry,rz degrees."""
    check_finite("ellipsoid", x, y, z, rx, ry, rz)
    check_positive("ellipsoid", "radius", a, b, c)

    def holds(points: Points) -> Bool[np.ndarray, " n"]:
        radii = np.array((a, b, c), np.float32)
        return squared_norm(_along(points, (x, y, z), (rx, ry, rz)) / radii) <= 1

    return Inside(holds)


def sphere(x: float, y: float, z: float, radius: float) -> Selection:
    """Select a ball about (x, y, z)."""
    check_finite("sphere", x, y, z)
    check_positive("sphere", "radius", radius)
    return Inside(lambda points: inside_ball(points, (x, y, z), radius))


def cylinder(
    x0: float, y0: float, z0: float, x1: float, y1: float, z1: float, radius: float
) -> Selection:
    """About the axis between two points, where it ends too."""
    start, end = (x0, y0, z0), (x1, y1, z1)
    check_finite("cylinder", *start, *end)
    check_positive("cylinder", "radius", radius)
    if start == end:
        raise UsageError("cylinder: its axis goes from a point to the same one: give two")

    def holds(points: Points) -> Bool[np.ndarray, " n"]:
        axis = np.subtract(end, start)
        length = float(np.linalg.norm(axis))
        unit = (axis / length).astype(np.float32)
        offset = points - np.array(start, np.float32)
        along = offset @ unit
        near = squared_norm(offset - along[:, None] * unit) <= np.square(np.float64(radius))
        return (along >= 0) & (along <= length) & near

    return Inside(holds)


def half_space(x: float, y: float, z: float, nx: float, ny: float, nz: float) -> Selection:
    """The side of the plane through x,y,z that the direction nx,ny,nz points to."""
    check_finite("half_space", x, y, z, nx, ny, nz)
    if not any((nx, ny, nz)):
        raise UsageError("half_space: the normal is 0,0,0: give a direction")

    def holds(points: Points) -> Bool[np.ndarray, " n"]:
        normal = np.array((nx, ny, nz)) / np.linalg.norm((nx, ny, nz))
        return (points - np.array((x, y, z), np.float32)) @ normal.astype(np.float32) >= 0

    return Inside(holds)


def check_finite(form: str, *numbers: float) -> None:
    """Raise UsageError for a number that is infinite or none."""
    if not all(map(isfinite, numbers)):
        raise UsageError(f"{form}: {', '.join(f'{n:g}' for n in numbers)} are not all finite")


def check_positive(form: str, what: str, *numbers: float) -> None:
    """Raise UsageError for a length that is not a finite number above 0."""
    for number in numbers:
        if not 0 < number < inf:
            raise UsageError(f"{form}: {what} {number:g}: it must be more than 0, and finite")


def _along(points: Points, center: Vector, degrees: Vector) -> Points:
    """Positions in the frame of a volume that is turned by `degrees`."""
    offset = points - np.array(center, np.float32)
    if not any(degrees):
        return offset
    from gsedit.scene.quaternions import axis_rotation  # which imports jaxtyping

    x, y, z = (axis_rotation(axis, angle) for axis, angle in zip(np.eye(3), degrees))
    return offset @ (z @ y @ x).astype(np.float32)


RAYS = 3
"""A point, of which the majority counts: one ray may pass through an edge."""


@dataclass(frozen=True)
class InsideMesh(Selection):
    """Select the inside of a closed surface in the coordinates of the scene: .obj, .ply, .stl,
    .off, .glb or .gltf."""

    path: Path

    def mask(self, table: SplatTable) -> Bool[np.ndarray, " n"]:
        file = existing_file(self.path)
        open3d = _library()
        casting, low, high = _casting(file, file.stat().st_mtime_ns)
        near = ((table.means >= low) & (table.means <= high)).all(1)  # and no NaN
        points = open3d.core.Tensor.from_numpy(np.ascontiguousarray(table.means[near]))
        inside = np.zeros(len(table), bool)
        inside[near] = casting.compute_occupancy(points, nsamples=RAYS).numpy() > 0.5
        return inside


@lru_cache(maxsize=4)
def _casting(path: Path, changed: int) -> tuple[Any, Any, Any]:
    """The scene to cast rays in and the mesh's bounds. Raises InputError for no closed mesh."""
    import trimesh

    from gsedit.formats.mesh_files import geometries

    open3d = _library()
    try:
        parts = [part for part in geometries(path) if hasattr(part, "faces")]
        mesh: Any = trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)  # they are repeated along seams
    except (GseditError, MemoryError):
        raise
    except Exception as error:  # its readers raise a dozen kinds
        reason = str(error).split("\n")[0]
        raise InputError(
            f"{path} is no mesh that can be read ({reason}): give .obj, .ply, .stl, .off or .glb"
        ) from None
    if not len(mesh.faces):
        raise InputError(f"{path} has no triangles: give a mesh as .obj, .ply, .stl, .off or .glb")
    if not mesh.is_watertight:
        raise InputError(
            f"{path} is no closed mesh (an edge does not belong to two triangles), so it has no "
            "inside: close its holes first"
        )
    casting = open3d.t.geometry.RaycastingScene()
    casting.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    low, high = mesh.bounds
    return casting, low, high


def _library() -> Any:
    return load_extra("open3d", "a selection by a mesh")
