"""Meshes and point clouds as Gaussians: .obj, .glb, .stl, .off, .ply, read by trimesh.

A mesh becomes flat disks on its surface with the colors of its texture, vertices or faces; a
point cloud becomes round Gaussians as wide as their neighbors are far.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float
from PIL import Image

from gsedit.errors import GseditError, InputError
from gsedit.formats.axes import LUF, from_axes
from gsedit.formats.gltf.document import Document
from gsedit.formats.limits import MAX_POSITION, check_expansion
from gsedit.formats.pictures import check_picture
from gsedit.formats.streams import ReadOptions, SceneHeader, SceneSource, in_blocks
from gsedit.run.inputs import file_inside, open_regular
from gsedit.scene.color_space import linear_of_srgb, srgb_of_linear
from gsedit.scene.neighbors import k_nearest
from gsedit.scene.table import SplatTable, concatenate_tables
from rasterizer.numerics import color_to_sh


def geometries(path: Path) -> Iterator[Any]:
    """Every part of the scene in a file, placed as its nodes say.

    Raises InputError for a file that trimesh cannot read, one that names a file outside of its
    folder, a face of vertices that are not there, and vertices that are not finite or beyond
    MAX_POSITION.
    """
    import trimesh

    refused: list[InputError] = []
    if path.suffix.lower() == ".glb":
        _check_zeros(path)
    try:
        with open_regular(path) as file:
            scene: Any = trimesh.load(
                BytesIO(file.read()),  # to read a length that a file only announces takes no memory
                path.suffix[1:].lower(),
                resolver=_resolver(path, refused),
                force="scene",
                process=False,
            )
        if refused:
            raise refused[0]
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            part = scene.geometry[name]
            _check(part)
            with np.errstate(all="ignore"):
                placed = part.copy().apply_transform(matrix)
            _check(placed)
            beside = getattr(getattr(part, "visual", None), "vertex_attributes", {})
            if (colors := beside.get("color")) is not None:  # which a copy of textures leaves out
                placed.visual.vertex_attributes["color"] = colors
            yield placed
    except (GseditError, MemoryError):
        raise
    except Exception as error:  # trimesh's readers raise whatever comes
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path} cannot be read as a mesh ({reason}): export it again") from None


def _check_zeros(path: Path) -> None:
    """Raise InputError where accessors of a glTF that have no bytes announce too many values."""
    made = [each for each in Document(path).items("accessors") if each.get("bufferView") is None]
    counts = [each.get("count") for each in made]
    values = sum(int(min(n, 1 << 60)) for n in counts if isinstance(n, int | float) and n > 0)
    check_expansion(path, path.stat().st_size, 64 * values)  # 16 floats at the most


def _check(part: Any) -> None:
    """Raise ValueError for a part that no arithmetic should meet, before it is copied."""
    vertices = np.asarray(getattr(part, "vertices", ()))
    if vertices.size and vertices.shape[1:] != (3,):
        raise ValueError("vertices have not three coordinates each")
    if not (np.abs(vertices) <= MAX_POSITION).all():
        raise ValueError(f"vertices are not finite or beyond {MAX_POSITION:g}")
    faces = np.asarray(getattr(part, "faces", ()))
    if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise ValueError(f"a face names a vertex that is not among the {len(vertices)}")
    material = getattr(getattr(part, "visual", None), "material", None)
    for picture in vars(material).values() if material is not None else ():
        for each in picture.values() if isinstance(picture, dict) else (picture,):
            if isinstance(each, Image.Image):
                check_picture(each)


def _resolver(path: Path, refused: list[InputError]) -> Any:
    """Resolver that trimesh asks for the files that a mesh names: those in its folder, no pipes.

    Errors other than that a file is missing go to `refused` too: trimesh does not pass them on.
    """
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        """Reads regular files in the folder of the mesh."""

        def get(self, name: str) -> bytes:
            try:
                place = file_inside(path.parent, name.strip(), str(path))
                if not place.exists():
                    raise FileNotFoundError(place)
                with open_regular(place) as file:
                    return file.read()
            except InputError as error:
                refused.append(error)
                raise

    return Beside(str(path))


DISK = 0.8
"""Standard deviation of a disk, in side lengths of the square that it stands for. The disks of a
surface then hide what is behind them: 4 of them overlap at a point on the average."""
BALL = 0.5
"""Standard deviation at a point, in distances to its neighbors."""
GREY = 0.6
"""The color of a surface that has none."""
Colors: TypeAlias = Callable[[Any, np.ndarray, np.ndarray], np.ndarray]
"""Callable (mesh, face indices n, barycentric weights n 3) that returns RGB, n 3."""


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Read a mesh or a point cloud, and sample it: `options.samples` Gaussians for the surfaces,
    one for each point. Raises InputError for a file that trimesh cannot read, or without either."""
    parts = list(geometries(path))
    surfaces = [p for p in parts if len(getattr(p, "faces", ())) and p.area > 0]
    clouds = [p for p in parts if not hasattr(p, "faces") and len(getattr(p, "vertices", ()))]
    if not surfaces and not clouds:
        raise InputError(f"{path} holds no surface and no points: export it again")
    total = sum(surface.area for surface in surfaces)
    rng = np.random.default_rng(0)
    shares = [max(1, round(options.samples * s.area / total)) for s in surfaces]
    gltf = path.suffix.lower() == ".glb"
    colors = _gltf_colors if gltf else _colors
    tables = [_disks(s, n, rng, colors) for s, n in zip(surfaces, shares)]
    tables += [_balls(cloud, linear=gltf) for cloud in clouds]
    table = concatenate_tables(tables)
    if gltf:  # as splats in glTF: +y is up there
        table = from_axes(table, LUF)
    notes = [f"a mesh: {sum(shares):,} Gaussians sampled on its surface"] * bool(surfaces)
    notes += [f"a point cloud: {sum(len(c.vertices) for c in clouds):,} round Gaussians"] * bool(
        clouds
    )
    left_out = len(parts) - len(surfaces) - len(clouds)
    notes += [f"parts without area or points left out: {left_out}"] * bool(left_out)
    kind = f"{path.suffix.lower()} mesh" if surfaces else f"{path.suffix.lower()} point cloud"
    return SceneSource(
        path, kind, SceneHeader(0), len(table), lambda: in_blocks(table), tuple(notes)
    )


def neighbor_distance(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Root mean squared distance to the three nearest other points."""
    near = min(4, len(points))
    if near < 2:
        return np.ones(len(points))
    distance, _ = k_nearest(points, points, near)
    return np.sqrt((distance[:, 1:] ** 2).mean(1))


def _disks(mesh: Any, count: int, rng: np.random.Generator, colors: Colors) -> SplatTable:
    """Flat Gaussians spread evenly over the surface of a mesh."""
    areas = np.asarray(mesh.area_faces, np.float64)
    # one sample in each of `count` equal parts of the area: faces get their share to within one
    ends = np.cumsum(areas)
    places = (np.arange(count) + rng.random(count)) / count * ends[-1]
    faces = np.searchsorted(ends, places).clip(0, len(areas) - 1)
    # within its face, along the sequence R2 (M. Roberts, 2018), whose points keep apart
    steps = np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    inside = (steps + rng.random(2)) % 1
    outside = inside.sum(1) > 1
    inside[outside] = 1 - inside[outside]
    weights = np.column_stack((1 - inside.sum(1), inside))
    points = (np.asarray(mesh.triangles)[faces] * weights[:, :, None]).sum(1)
    sizes = np.array([DISK, DISK, 0.05 * DISK]) * np.sqrt(ends[-1] / count)
    return _table(
        points, turned_to(np.asarray(mesh.face_normals)[faces]), sizes,
        colors(mesh, faces, weights),
    )  # fmt: skip


def _balls(cloud: Any, *, linear: bool) -> SplatTable:
    """Round Gaussians at points, which may have colors: display colors, or linear light."""
    points = np.asarray(cloud.vertices, np.float64)
    sizes = BALL * np.maximum(neighbor_distance(points), 1e-7)[:, None].repeat(3, 1)
    colors = np.asarray(getattr(cloud, "colors", ()))
    if colors.shape[:1] != points.shape[:1]:
        colors = GREY
    else:
        colors = srgb_of_linear(colors[:, :3] / 255) if linear else colors[:, :3] / 255
    identity = np.broadcast_to([1.0, 0, 0, 0], (len(points), 4))
    return _table(points, identity, sizes, np.broadcast_to(colors, points.shape))


def _table(
    points: np.ndarray, quats: np.ndarray, sizes: np.ndarray, colors: np.ndarray
) -> SplatTable:
    """Opaque Gaussians of one color each."""
    n = len(points)
    sh = color_to_sh(colors)[:, None]
    log_scales = np.log(np.broadcast_to(sizes, (n, 3)))
    arrays = (points, quats, log_scales, np.full(n, 4.0), sh)  # an opacity of 0.98
    means, quats, logs, logits, sh = (np.array(a, np.float32, order="C") for a in arrays)
    return SplatTable(means, quats, logs, logits, sh)


def _colors(
    mesh: Any, faces: np.ndarray, weights: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Sample the colors of points on a mesh, in [0, 1]."""
    visual = mesh.visual
    corners = np.asarray(mesh.faces)[faces]
    material = getattr(visual, "material", None)
    uv = _uv(mesh)
    if material is not None:
        picture = getattr(material, "image", None)
        factor = np.asarray(material.main_color, np.float64)[:3] / 255
        if not isinstance(picture, Image.Image) or uv is None:
            return np.broadcast_to(factor, (len(faces), 3))
        at = (uv[corners] * weights[:, :, None]).sum(1)
        return _texels(picture, at)
    if visual.kind == "vertex":
        values = np.asarray(visual.vertex_colors, np.float64)[corners, :3] / 255
        return (values * weights[:, :, None]).sum(1)
    if visual.kind == "face":
        return np.asarray(visual.face_colors, np.float64)[faces, :3] / 255
    return np.full((len(faces), 3), GREY)


def _gltf_colors(
    mesh: Any, faces: np.ndarray, weights: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """`_colors` of a glTF: the product, in linear light, of the base color's factor and its
    texture and of the colors of the vertices. The texture alone is stored as display colors.
    Source: glTF 2.0, 3.7.2.1 (meshes) and 3.9.2 (metallic-roughness material)."""
    visual, corners = mesh.visual, np.asarray(mesh.faces)[faces]
    material = getattr(visual, "material", None)
    of_vertices = visual.vertex_attributes.get("color") if material is not None else None
    if material is None:
        if visual.kind != "vertex":
            return np.full((len(faces), 3), GREY)
        of_vertices = visual.vertex_colors
    factor = getattr(material, "baseColorFactor", None)
    light = np.ones((len(faces), 3)) if factor is None else np.asarray(factor, float)[:3] / 255
    picture, uv = getattr(material, "baseColorTexture", None), _uv(mesh)
    if isinstance(picture, Image.Image) and uv is not None:
        at = (uv[corners] * weights[:, :, None]).sum(1)
        light = light * linear_of_srgb(_texels(picture, at))
    if of_vertices is not None and len(of_vertices) == len(mesh.vertices):
        levels = np.asarray(of_vertices)
        most = np.iinfo(levels.dtype).max if levels.dtype.kind == "u" else 1
        light = light * (levels[corners, :3] / most * weights[:, :, None]).sum(1)
    return srgb_of_linear(np.broadcast_to(light, (len(faces), 3)))


def _uv(mesh: Any) -> Float[np.ndarray, "v 2"] | None:
    """The texture coordinates of the vertices; None where there are none for all of them."""
    uv = np.asarray(getattr(mesh.visual, "uv", None), np.float64)
    return (
        uv[:, :2] if uv.ndim == 2 and uv.shape[1] >= 2 and len(uv) == len(mesh.vertices) else None
    )


def _texels(picture: Any, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Colors of a picture, repeated, at texture coordinates whose v points up: bilinear."""
    from scipy.ndimage import map_coordinates

    pixels = np.asarray(picture.convert("RGB"))
    height, width = pixels.shape[:2]
    places = (1 - uv[:, 1] % 1) * height - 0.5, uv[:, 0] % 1 * width - 0.5
    look_up = partial(map_coordinates, coordinates=places, output=float, order=1, mode="grid-wrap")
    return np.stack([look_up(pixels[..., channel]) for channel in range(3)], -1) / 255


def turned_to(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Rotations wxyz that take the z axis to each normal the short way."""
    quats = np.column_stack(
        (1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(len(normals)))
    )
    quats[normals[:, 2] < -0.999999] = [0, 1, 0, 0]
    return quats / np.linalg.norm(quats, axis=1, keepdims=True)
