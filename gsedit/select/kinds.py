"""Kinds of selections: by value, rank, color, volume, file or camera, each by a function.

`gsedit.select.where` calls the functions of `FORMS` and `VALUES` by their names, and reads the
types of their parameters. Coordinates and lengths are those of the scene's file (see
gsedit.scene.table); angles are degrees about x, then y, then z. The surface of a volume is inside.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import lru_cache
from math import ceil, inf, isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.formats.flags import read_flags
from gsedit.run.environment import load_extra
from gsedit.run.inputs import existing_file
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.neighbors import k_nearest, linked
from gsedit.scene.shapes import Bool, Float, Float32, Float64, Int
from gsedit.scene.table import SplatTable, gaussians_of

if TYPE_CHECKING:
    from gsedit.views.dataset import View
    from gsedit.views.viewpoints import Viewpoint


def inside_box(
    points: Float[np.ndarray, "n 3"], low: Sequence[float], high: Sequence[float]
) -> Bool[np.ndarray, " n"]:
    """Flag the points between two corners; a side is open where a corner is infinite."""
    inside = np.ones(len(points), bool)
    for axis in range(3):
        if low[axis] > -inf:
            inside &= points[:, axis] >= low[axis]
        if high[axis] < inf:
            inside &= points[:, axis] <= high[axis]
    return inside


def squared_norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Squared lengths; infinite where they leave the float type."""
    return np.einsum("ij,ij->i", vectors, vectors)


QUIET = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""For masks that compute: a damaged row is not selected, and no reason for a warning."""
Vector = tuple[float, float, float]
Points = Float32[np.ndarray, "n 3"]
Flags = Bool[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Selection:
    """A rule that selects Gaussians of a scene; `a & b`, `a | b` and `~a` make others of it."""

    mask: Callable[[SplatTable], Flags]
    """Tells whether each row is selected, and does not write into the arrays of the table.

    A row with NaN where the rule looks is not selected by it, so its complement selects it. Raises
    UsageError for a column that the scene lacks, InputError for a file that does not fit."""
    whole: bool = False
    """Whether `mask` must be given all rows of the scene at once, in the order of its file."""
    view_dependent: bool = False
    """Whether `mask` looks at the bands of SH above the first."""
    files: tuple[Path, ...] = ()
    """Files of saved flags that it reads."""
    question: Callable[[Any], Any] | None = None
    """Asks a `gsedit.select.finder.Finder` for a Region, where a scene has to be looked at."""

    def __and__(self, other: Selection) -> Selection:
        return combined(np.logical_and.reduce, self, other)

    def __or__(self, other: Selection) -> Selection:
        return combined(np.logical_or.reduce, self, other)

    def __invert__(self) -> Selection:
        return combined(lambda masks: ~masks[0], self)


def combined(join: Callable[[list[Flags]], Flags], *parts: Selection) -> Selection:
    """A selection of the masks of others, that needs what they need."""
    return Selection(
        lambda table: join([part.mask(table) for part in parts]),
        any(part.whole for part in parts),
        any(part.view_dependent for part in parts),
        tuple(file for part in parts for file in part.files),
    )


def given(inside: Flags) -> Selection:
    """The selection of flags that are known already, one for each row."""
    return Selection(lambda table: inside, whole=True)


def saved_flags(asked: object) -> Iterator[Path]:
    """The files of saved flags that an operation or a selection asks, in its fields and theirs."""
    if isinstance(asked, Selection):
        yield from asked.files
    elif isinstance(asked, tuple):
        for each in asked:
            yield from saved_flags(each)
    elif is_dataclass(asked) and not isinstance(asked, type):
        for field in fields(asked):
            yield from saved_flags(getattr(asked, field.name))


EVERYTHING = Selection(lambda table: np.ones(len(table), bool))


def flags(path: str) -> Selection:
    """Select by a .npy file of flags, such as `gsedit select` writes."""
    file = Path(path).expanduser()
    return Selection(lambda table: read_flags(file, len(table)), whole=True, files=(file,))


# ---- values -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Value:
    """A number that every Gaussian has."""

    of: Callable[[SplatTable], Any]
    """One number a row, of any type; or one number for all rows."""
    number: float | None = None
    """The number that is equal for all Gaussians; None for another value."""


NAMED: dict[str, tuple[str, Callable[[SplatTable], Any]]] = {
    "x": ("coordinate of the center", lambda table: table.means[:, 0]),
    "y": ("coordinate of the center", lambda table: table.means[:, 1]),
    "z": ("coordinate of the center", lambda table: table.means[:, 2]),
    "opacity": ("0 to 1", lambda table: table.opacities),
    "size": (
        "geometric mean of the three standard deviations",
        lambda table: np.exp(table.log_scales.mean(1)),
    ),
    "longest": ("largest standard deviation", lambda table: np.exp(table.log_scales.max(1))),
    "shortest": ("smallest standard deviation", lambda table: np.exp(table.log_scales.min(1))),
    "anisotropy": (
        "longest / shortest",
        lambda table: np.exp(table.log_scales.max(1) - table.log_scales.min(1)),
    ),
    "red": ("0 to 1, without view dependence", lambda table: table.colors[:, 0]),
    "green": ("0 to 1, without view dependence", lambda table: table.colors[:, 1]),
    "blue": ("0 to 1, without view dependence", lambda table: table.colors[:, 2]),
    "luminance": (  # the luma of Rec. 709
        "0.2126 red + 0.7152 green + 0.0722 blue",
        lambda table: table.colors @ np.array((0.2126, 0.7152, 0.0722), np.float32),
    ),
}
"""Values by name: what each is, and how it is computed. Lengths are in units of the scene."""


def value_named(name: str) -> Value:
    """A value of `NAMED`, or else an extra column of the file."""
    return Value(NAMED[name][1]) if name in NAMED else column(name)


def column(name: str) -> Value:
    """An extra column of the file."""

    def of(table: SplatTable) -> Any:
        if name in table.extra:
            return table.extra[name]
        known = [*NAMED, *table.extra]
        close = get_close_matches(name, known, 1)
        move = f"did you mean {close[0]}?" if close else f"the scene has {', '.join(known)}"
        raise UsageError(f"no value and no column of the scene is named {name}: {move}")

    return Value(of)


def distance(x: float, y: float, z: float) -> Value:
    """From x,y,z to the center."""
    check_finite("distance", x, y, z)
    point = np.array((x, y, z), np.float32)
    return Value(lambda table: np.linalg.norm(table.means - point, axis=1))


def absolute(value: Value) -> Value:
    """Absolute value of a number."""
    return computed(abs, value)


def computed(operator: Callable[..., Any], *operands: Value) -> Value:
    """Result of arithmetic on values. Whole numbers become float64: differences of a column of
    bytes would wrap round."""

    def real(numbers: Any) -> Any:
        whole = isinstance(numbers, np.ndarray) and numbers.dtype.kind in "biu"
        return numbers.astype(np.float64) if whole else numbers

    return Value(lambda table: operator(*(real(each.of(table)) for each in operands)))


def compare(left: Value, operator: Callable[[Any, Any], Any], right: Value) -> Selection:
    """Select rows for which `left operator right` holds."""

    def mask(table: SplatTable) -> Flags:
        found = operator(left.of(table), right.of(table))
        return np.broadcast_to(np.asarray(found, bool), len(table))

    return Selection(QUIET(mask))


Amount = Callable[[int], int]
"""Rows of a number of all rows."""


def parse_amount(text: str) -> Amount:
    """The rows of `1000`, or of the share `10 %`, which is rounded up. Raises UsageError."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(%?)\s*", text)
    if match is None or (not match[2] and "." in match[1]):
        raise UsageError(f"{text!r} is no amount: give a count, as in 1000, or a share, as in 10%")
    number = float(match[1])
    if match[2] and number > 100:
        raise UsageError(f"{number:g} %: give a count of 0 or more, or 0 % to 100 %")
    return lambda count: min(ceil(number * count / 100) if match[2] else int(number), count)


def largest(amount: Amount, value: Value) -> Selection:
    """The rows with the largest values: 1000 of them, or '10%'."""
    return smallest(amount, Value(lambda table: -np.asarray(value.of(table), np.float64)))


def smallest(amount: Amount, value: Value) -> Selection:
    """The rows with the smallest values: 1000 of them, or '10%'."""

    def mask(table: SplatTable) -> Flags:
        numbers = np.broadcast_to(np.asarray(value.of(table), np.float64), len(table))
        inside = np.zeros(len(table), bool)
        # of equals the first ones, and NaN comes last
        inside[np.argsort(numbers, kind="stable")[: amount(len(table))]] = True
        return inside

    return Selection(QUIET(mask), whole=True)


def near(color: str, difference: float = 10.0) -> Selection:
    """Select colors that differ by at most `difference` (CIE 1976, in Lab) from #rrggbb, or from a
    pixel given as `photo.jpg@COLUMN,ROW`: 2 is just noticeable, 10 a shade, 30 another hue."""
    picked = lab_of_srgb(np.array([parse_color(color)]))
    check_positive("near", "difference", difference)

    def mask(table: SplatTable) -> Flags:
        apart = lab_of_srgb(np.clip(table.colors, 0, 1)) - picked
        return np.linalg.norm(apart, axis=1) <= difference

    return Selection(QUIET(mask))


def parse_color(text: str) -> Vector:
    """Red, green and blue, 0 to 1, of `#rrggbb`, `#rgb`, or of the pixel `PICTURE@COLUMN,ROW`.

    Raises UsageError for another text or a pixel outside, InputError for no picture.
    """
    if "@" in text:
        return _pixel(text)
    digits = text.removeprefix("#")
    if not re.fullmatch(r"[0-9a-fA-F]{3}|[0-9a-fA-F]{6}", digits):
        raise UsageError(f"color {text}: give #rrggbb, as in #a08050, or a pixel, as photo.jpg@8,9")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    red, green, blue = srgb_of_hex(digits).tolist()
    return red, green, blue


def _pixel(text: str) -> Vector:
    from gsedit.formats.pictures import open_picture

    name, _, place = text.rpartition("@")
    path = existing_file(Path(name).expanduser())
    try:
        column, row = (int(number) for number in place.split(","))
    except ValueError:
        raise UsageError(f"color {text}: name a pixel by column and row: {name}@8,9") from None
    with open_picture(path) as picture:
        shown = np.asarray(picture.convert("RGB"))
    height, width = shown.shape[:2]
    if not (0 <= column < width and 0 <= row < height):
        raise UsageError(f"color {text}: the picture has {width}x{height} pixels, from 0,0")
    red, green, blue = (shown[row, column] / 255).tolist()
    return red, green, blue


# ---- volumes ------------------------------------------------------------------------------------


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
    return _within(lambda points: inside_box(points, lows, highs))


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


def check_finite(form: str, *numbers: float) -> None:
    """Raise UsageError for a number that is infinite or none."""
    if not all(map(isfinite, numbers)):
        raise UsageError(f"{form}: {', '.join(f'{n:g}' for n in numbers)} are not all finite")


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
            from gsedit.scene.quaternions import axis_rotation  # which imports jaxtyping

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

TYPICAL = 8.0
"""A gap, in median distances of a Gaussian to its nearest one, where none is given."""
MIXED = np.array((0x1E3779B97F4A7C15, 0x42B2AE3D27D4EB4F, 0x165667B19E3779F9), np.int64)
"""Large odd factors that make one number of a cell's three; it wraps round, and two cells share one
by a chance of less than one in a million."""


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


def typical_gap(points: Float64[np.ndarray, "n 3"]) -> float:
    """`TYPICAL` median distances to the nearest other place."""
    places = np.unique(points, axis=0)
    if len(places) < 2:
        return 1.0
    asked = places[:: -(-len(places) // 20_000)]
    distance, _ = k_nearest(places, asked, 2)
    return TYPICAL * float(np.median(distance[:, 1]))


def cluster_labels(points: Float64[np.ndarray, "n 3"], gap: float) -> Int[np.ndarray, " n"]:
    """The number of each point's cluster, from 0.

    Points are sorted into cells whose points all are at most `gap` apart; then cells are linked.
    """
    from scipy.spatial import KDTree

    side = gap / np.sqrt(3) * (1 - 1e-9)
    cells = np.floor(points / side)
    bits = (cells + 0.0).view(np.int64)  # of any size; -0 is 0
    keys = (bits ^ (bits >> 29)) @ MIXED
    order = np.argsort(keys, kind="stable")
    _, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    middles, sample = side * (cells[order[first]] + 0.5), points[order[first]]
    pairs = KDTree(middles).query_pairs(2 * gap, output_type="ndarray")
    near = np.linalg.norm(sample[pairs[:, 0]] - sample[pairs[:, 1]], axis=1) <= gap
    labels = linked(pairs[near], len(first))
    # two centers of the cells may be nearer than those that were compared
    rest = pairs[(labels[pairs[:, 0]] != labels[pairs[:, 1]]) & (counts[pairs].max(1) > 1)]
    rest = rest[_touch(points[order], first, counts, rest, gap)]
    labels = linked(labels[rest], int(labels.max()) + 1)[labels]
    result = np.empty(len(points), np.int64)
    result[order] = np.repeat(labels, counts)
    return result


def _touch(
    points: Float64[np.ndarray, "n 3"],
    first: np.ndarray,
    counts: np.ndarray,
    pairs: np.ndarray,
    gap: float,
) -> Bool[np.ndarray, " p"]:
    """Whether two points of a pair of cells are at most `gap` apart; points in order of cells.

    All pairs in one k-d tree: each has a place of its own along a fourth axis.
    """
    if not len(pairs):
        return np.zeros(0, bool)
    origin = points[first[pairs[:, 0]]]

    def placed(side: int) -> tuple[np.ndarray, np.ndarray]:
        many = counts[pairs[:, side]]
        pair = np.repeat(np.arange(len(pairs)), many)
        start = np.cumsum(many) - many
        row = np.arange(len(pair)) - start[pair] + first[pairs[pair, side]]
        apart = (points[row] - origin[pair]) / gap
        return np.column_stack([apart, 16.0 * pair]), pair

    tree, _ = placed(1)
    asked, pair = placed(0)
    distance, _ = k_nearest(tree, asked, 1, bound=1 + 1e-12)
    return np.bincount(pair[np.isfinite(distance[:, 0])], minlength=len(pairs)) > 0


def grow(selection: Selection, radius: float) -> Selection:
    """A selection, and what is at most `radius` from it."""
    check_positive("grow", "radius", radius)
    return _of_whole(selection, lambda inside, table: inside | _beside(table.means, inside, radius))


def shrink(selection: Selection, radius: float) -> Selection:
    """A selection, without what is at most `radius` from the rest."""
    check_positive("shrink", "radius", radius)
    return _of_whole(
        selection, lambda inside, table: inside & ~_beside(table.means, ~inside, radius)
    )


def _beside(
    means: Float32[np.ndarray, "n 3"], sources: Bool[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Whether a row is no source, and at most `radius` from one."""
    usable = np.isfinite(means).all(1)
    found = np.zeros(len(means), bool)
    given, asked = usable & sources, np.flatnonzero(usable & ~sources)
    if not given.any() or not len(asked):
        return found
    points = means[asked]
    # far points are cheap to leave out, and most are far
    low, high = means[given].min(0) - radius, means[given].max(0) + radius
    near = ((points >= low) & (points <= high)).all(1)
    # query asks for distances below its bound: the next number includes the bound itself
    distance, _ = k_nearest(means[given], points[near], 1, bound=np.nextafter(radius, np.inf))
    found[asked[near]] = np.isfinite(distance[:, 0])
    return found


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
VALUES: dict[str, Callable[..., Value]] = {"distance": distance, "column": column, "abs": absolute}
"""Functions that give a number a Gaussian, by their names in expressions."""
