"""Kinds of selections: by color, volume, file, camera or neighbors, each by a function.

`gsedit.select.where` calls the functions of `FORMS` by their names, and reads the types of their
parameters. Coordinates and lengths are those of the scene's file (see gsedit.scene.table); angles
are degrees about x, then y, then z. The surface of a volume is inside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from math import inf, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsedit.errors import InputError, UsageError
from gsedit.formats.flags import read_flags
from gsedit.run.environment import load_extra
from gsedit.run.inputs import existing_file
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.neighbors import beside, cluster_labels, typical_gap
from gsedit.scene.quaternions import axis_rotation
from gsedit.scene.shapes import Float, Float32
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.selection import EVERYTHING, QUIET, Flags, Selection
from gsedit.select.values import check_finite, largest, smallest

if TYPE_CHECKING:
    from gsedit.views.dataset import View
    from gsedit.views.viewpoints import Viewpoint

Vector = tuple[float, float, float]
Points = Float32[np.ndarray, "n 3"]


def flags(path: str) -> Selection:
    """Select by a .npy file of flags, such as `gsedit select` writes."""
    file = Path(path).expanduser()
    return Selection(lambda table: read_flags(file, len(table)), whole=True, files=(file,))


def near(color: str, difference: float = 10.0) -> Selection:
    """Select colors that differ by at most `difference` (CIE 1976, in Lab) from #rrggbb, or from a
    pixel given as `photo.jpg@COLUMN,ROW`: 2 is just noticeable, 10 a shade, 30 another hue."""
    picked = lab_of_srgb(parse_color(color))
    check_positive("near", "difference", difference)

    def mask(table: SplatTable) -> Flags:
        apart = lab_of_srgb(np.clip(table.colors, 0, 1)) - picked
        return np.linalg.norm(apart, axis=1) <= difference

    return Selection(QUIET(mask))


def parse_color(text: str) -> Float[np.ndarray, "3"]:
    """Color, 0 to 1, of `#rrggbb`, `#rgb`, or of the pixel `PICTURE@COLUMN,ROW`.

    Raises UsageError for another text or a pixel outside, InputError for no picture.
    """
    if "@" in text:
        from gsedit.formats.pictures import color_at

        return color_at(text)
    digits = text.removeprefix("#")
    try:
        return srgb_of_hex("".join(2 * each for each in digits) if len(digits) == 3 else digits)
    except ValueError:
        wanted = "give #rrggbb, as in #a08050, or a pixel, as photo.jpg@8,9"
        raise UsageError(f"color {text}: {wanted}") from None


# ---- volumes ------------------------------------------------------------------------------------


def squared_norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Squared lengths; infinite where they leave the float type."""
    return np.einsum("ij,ij->i", vectors, vectors)


def _within(holds: Callable[[Points], Flags]) -> Selection:
    """Select the centers that a volume holds."""
    return Selection(QUIET(lambda table: holds(table.means)))


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

    def holds(points: Points) -> Flags:
        low, high = np.array((lows, highs), np.float32)
        return ((points >= low) & (points <= high)).all(1)

    return _within(holds)


def oriented_box(
    x: float, y: float, z: float, a: float, b: float, c: float,
    rx: float = 0.0, ry: float = 0.0, rz: float = 0.0,
) -> Selection:  # fmt: skip
    """About x,y,z, with sides of lengths a, b and c, turned by rx,ry,rz degrees."""
    place = _placed("oriented_box", "side", (x, y, z), (a, b, c), (rx, ry, rz))
    return _within(lambda points: np.all(np.abs(place(points)) <= 0.5, axis=1))


def ellipsoid(
    x: float, y: float, z: float, a: float, b: float, c: float,
    rx: float = 0.0, ry: float = 0.0, rz: float = 0.0,
) -> Selection:  # fmt: skip
    """About x,y,z, with radii a, b and c, turned by rx,ry,rz degrees."""
    place = _placed("ellipsoid", "radius", (x, y, z), (a, b, c), (rx, ry, rz))
    return _within(lambda points: squared_norm(place(points)) <= 1)


def sphere(x: float, y: float, z: float, radius: float) -> Selection:
    """Select a ball about (x, y, z)."""
    check_finite("sphere", x, y, z)
    check_positive("sphere", "radius", radius)
    center = np.array((x, y, z), np.float32)
    return _within(lambda points: squared_norm(points - center) <= np.square(np.float64(radius)))


def cylinder(
    x0: float, y0: float, z0: float, x1: float, y1: float, z1: float, radius: float
) -> Selection:
    """About the axis between two points, where it ends too."""
    start, end = (x0, y0, z0), (x1, y1, z1)
    check_finite("cylinder", *start, *end)
    check_positive("cylinder", "radius", radius)
    if start == end:
        raise UsageError("cylinder: its axis goes from a point to the same one: give two")

    def holds(points: Points) -> Flags:
        axis = np.subtract(end, start)
        length = float(np.linalg.norm(axis))
        unit = (axis / length).astype(np.float32)
        offset = points - np.array(start, np.float32)
        along = offset @ unit
        near = squared_norm(offset - along[:, None] * unit) <= np.square(np.float64(radius))
        return (along >= 0) & (along <= length) & near

    return _within(holds)


def half_space(x: float, y: float, z: float, nx: float, ny: float, nz: float) -> Selection:
    """The side of the plane through x,y,z that the direction nx,ny,nz points to."""
    check_finite("half_space", x, y, z, nx, ny, nz)
    if not any((nx, ny, nz)):
        raise UsageError("half_space: the normal is 0,0,0: give a direction")
    normal = (np.array((nx, ny, nz)) / np.linalg.norm((nx, ny, nz))).astype(np.float32)
    return _within(lambda points: (points - np.array((x, y, z), np.float32)) @ normal >= 0)


def check_positive(form: str, what: str, *numbers: float) -> None:
    """Raise UsageError for a length that is not a finite number above 0."""
    for number in numbers:
        if not 0 < number < inf:
            raise UsageError(f"{form}: {what} {number:g}: it must be more than 0, and finite")


def _placed(
    form: str, what: str, center: Vector, sizes: Vector, degrees: Vector
) -> Callable[[Points], Points]:
    """A map to positions in the frame of a volume that is turned by `degrees`, in its sizes."""
    check_finite(form, *center, *degrees)
    check_positive(form, what, *sizes)

    def place(points: Points) -> Points:
        offset = points - np.array(center, np.float32)
        if any(degrees):
            x, y, z = (axis_rotation(axis, angle) for axis, angle in zip(np.eye(3), degrees))
            offset = offset @ (z @ y @ x).astype(np.float32)
        return offset / np.array(sizes, np.float32)

    return place


def inside(mesh: str) -> Selection:
    """Select the inside of a closed mesh: .obj, .ply, .stl, .off or .glb."""

    def mask(table: SplatTable) -> Flags:
        file = existing_file(Path(mesh).expanduser())
        open3d = load_extra("open3d", "a selection by a mesh")
        casting, low, high = _casting(file, file.stat().st_mtime_ns)
        near = ((table.means >= low) & (table.means <= high)).all(1)  # and no NaN
        points = open3d.core.Tensor.from_numpy(np.ascontiguousarray(table.means[near]))
        found = np.zeros(len(table), bool)
        # of which the majority counts: one may pass through an edge
        found[near] = casting.compute_occupancy(points, nsamples=3).numpy() > 0.5
        return found

    return Selection(mask)


@lru_cache(maxsize=4)
def _casting(path: Path, changed: int) -> tuple[Any, Any, Any]:
    """The scene to cast rays in and the mesh's bounds. Raises InputError for no closed mesh."""
    import trimesh

    from gsedit.formats.mesh import geometries

    parts = [part for part in geometries(path) if hasattr(part, "faces")]
    mesh: Any = trimesh.util.concatenate(parts) if parts else trimesh.Trimesh()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)  # they are repeated along seams
    if not len(mesh.faces):
        raise InputError(f"{path} has no triangles: give a mesh as .obj, .ply, .stl, .off or .glb")
    if not mesh.is_watertight:
        raise InputError(
            f"{path} is no closed mesh (an edge does not belong to two triangles), so it has no "
            "inside: close its holes first"
        )
    casting = load_extra("open3d", "a selection by a mesh").t.geometry.RaycastingScene()
    casting.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    low, high = mesh.bounds
    return casting, low, high


# ---- cameras of a capture: torch is loaded when a mask is asked for -----------------------------

SIZE_PIXELS = 256
"""Longer side of the pictures, pixels."""
LEAST_PIXELS = 0.01
"""Pixels of that size, in all pictures together: less than the eye sees of a Gaussian."""
CAMERAS = 64
"""Largest number of cameras; of more, every k-th is taken: each costs a render and its backward
pass."""


def views_of(cameras: str, scene: str) -> Sequence[View | Viewpoint]:
    """The cameras of a cameras.json or of a folder of posed photos, on pictures SIZE_PIXELS wide.

    The dataparser_transforms.json beside `scene`, the file that they belong to, tells the frame of
    an export; "": the frame of the file that is selected from. Raises InputError for no cameras.
    """
    from gsedit.views.cameras_json import NAME, read_cameras
    from gsedit.views.export_frame import in_export_frame
    from gsedit.views.load import load_dataset
    from gsedit.views.viewpoints import same_size

    path = Path(cameras).expanduser()
    if (path / NAME).is_file():
        path = path / NAME
    if path.is_file() and path.name != "transforms.json":
        return same_size(read_cameras(path), SIZE_PIXELS)
    photos = load_dataset(path, size=SIZE_PIXELS)
    return (in_export_frame(photos, path, Path(scene)) if scene else photos).views


def seen(cameras: str, pixels: float = LEAST_PIXELS, scene: str = "") -> Selection:
    """Select Gaussians that contribute `pixels` or more to the pictures of a cameras.json or of
    posed photos, all together.

    The contribution to a pixel is the blending weight: what is hidden has none. Pictures are
    `SIZE_PIXELS` pixels wide, of at most `CAMERAS` cameras.
    """
    if not pixels > 0:
        raise UsageError(f"seen: {pixels:g} pixels: give more than 0")

    def mask(table: SplatTable) -> Flags:
        import torch

        from rasterizer.render import contributions

        if not len(table):
            return np.zeros(0, bool)
        every = views_of(cameras, scene)
        with torch.no_grad():
            gaussians = gaussians_of(table)
            total = torch.zeros(len(gaussians))
            for view in every[:: -(-len(every) // CAMERAS)]:
                total += contributions(gaussians, view.camera)
        return (total >= pixels).numpy()

    return Selection(mask, whole=True)


def middle(within: float, cameras: str, scene: str = "") -> Selection:
    """Gaussians near the point that the cameras of a cameras.json or of posed photos look at.

    `within` is a multiple of the median distance of the cameras from that point; 1 is about the
    part that an orbit of cameras encloses.
    """
    if not 0 < within < inf:
        raise UsageError(f"within {within:g}: give a number above 0")

    def mask(table: SplatTable) -> Flags:
        import torch

        from gsedit.views.paths import common_point

        found = [view.camera for view in views_of(cameras, scene)]
        middle = common_point(found)
        if middle is None:
            raise UsageError("the cameras look at no common point: use sphere(x, y, z, radius)")
        centers = torch.stack([camera.center.detach().double() for camera in found])
        distance = np.median((centers - middle).norm(dim=1).numpy())
        away = np.linalg.norm(table.means.astype(np.float64) - middle.numpy(), axis=1)
        return away <= within * distance

    return Selection(mask, whole=True)


# ---- neighbors ----------------------------------------------------------------------------------


def cluster(n: int = 1, gap: float | None = None, of: Selection = EVERYTHING) -> Selection:
    """The n largest clusters: of centers linked by gaps of at most `gap`, among `of`."""
    if n < 1:
        raise UsageError(f"cluster: {n} clusters: give 1 or more")
    return _clusters(
        lambda points, labels: np.argsort(-np.bincount(labels), kind="stable")[:n], gap, of
    )


def cluster_at(
    x: float, y: float, z: float, gap: float | None = None, of: Selection = EVERYTHING
) -> Selection:
    """The cluster of the center nearest to x,y,z."""
    check_finite("cluster", x, y, z)
    return _clusters(
        lambda points, labels: labels[[np.linalg.norm(points - (x, y, z), axis=1).argmin()]],
        gap, of,
    )  # fmt: skip


def _clusters(
    choose: Callable[[np.ndarray, np.ndarray], np.ndarray], gap: float | None, of: Selection
) -> Selection:
    """The clusters among what `of` selects whose numbers are chosen, from points and labels."""
    if gap is not None:
        check_positive("cluster", "gap", gap)

    def change(among: Flags, table: SplatTable) -> Flags:
        rows = np.flatnonzero(among & np.isfinite(table.means).all(1))
        inside = np.zeros(len(table), bool)
        if len(rows):
            points = table.means[rows].astype(np.float64)
            labels = cluster_labels(points, typical_gap(points) if gap is None else gap)
            inside[rows[np.isin(labels, choose(points, labels))]] = True
        return inside

    return _of_whole(of, change)


def _of_whole(inner: Selection, change: Callable[[Flags, SplatTable], Flags]) -> Selection:
    """A selection of the mask of another, that needs all rows at once."""
    return replace(inner, mask=lambda table: change(inner.mask(table), table), whole=True)


def grow(selection: Selection, radius: float) -> Selection:
    """A selection, and what is at most `radius` from it."""
    check_positive("grow", "radius", radius)
    return _of_whole(selection, lambda inside, table: inside | beside(table.means, inside, radius))


def shrink(selection: Selection, radius: float) -> Selection:
    """A selection, without what is at most `radius` from the rest."""
    check_positive("shrink", "radius", radius)
    return _of_whole(
        selection, lambda inside, table: inside & ~beside(table.means, ~inside, radius)
    )


FORMS: dict[str, Callable[..., Selection]] = {
    **{
        form.__name__: form
        for form in (
            *(box, oriented_box, sphere, ellipsoid, cylinder, half_space, near, flags),
            *(largest, smallest, inside, seen, middle, cluster, cluster_at, grow, shrink),
        )
    },
    "all": lambda: EVERYTHING,
}
"""Selections by their names in expressions."""
