"""glTF's KHR_gaussian_splatting, as .glb.

Splats are a primitive of POINTS: linear scales and opacities, rotations xyzw, SH as INRIA's. glTF
is right-handed with +y up and the front of an asset along +z, so its axes are left, up, front
against memory's right, down, front: half a turn about z, as Niantic's and PlayCanvas' writers do.
Reading holds one block. Writing keeps each attribute in a file of its own until all are known.
Source: github.com/KhronosGroup/glTF, extensions/2.0/Khronos/KHR_gaussian_splatting (ratified 2026).
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError, UsageError
from gsedit.formats.axes import LUF, from_axes, to_axes
from gsedit.formats.gltf.document import AGAIN, GLB_CHUNK, GLB_HEADER, Accessor, Document
from gsedit.formats.quantised import log_scales_of, logits_of
from gsedit.formats.streams import AT_ONCE, PROGRAM, Blocks, ReadOptions, SceneHeader, SceneSource
from gsedit.scene.quaternions import rotation_of
from gsedit.scene.similarity import IDENTITY, Similarity, similarity_of
from gsedit.scene.table import SplatTable

EXTENSION = "KHR_gaussian_splatting"
_SCENE: dict[str, Any] = {
    "asset": {"version": "2.0", "generator": "gsedit"},
    "extensionsUsed": [EXTENSION],
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
}
_ABOUT = {
    "kernel": "ellipse",
    "colorSpace": "srgb_rec709_display",
    "sortingMethod": "cameraDistance",
    "projection": "perspective",
}
_POINTS, _FLOAT, _BYTE, _ARRAY_BUFFER = 0, 5126, 5121, 34962


@dataclass(frozen=True)
class _Splats:
    """One primitive, placed by its nodes."""

    attributes: dict[str, Accessor]
    degree: int
    count: int
    place: Similarity
    logarithmic: bool
    """Scales as drafts of the extension had them."""
    unusual: tuple[str, ...]
    """Properties that the file declares and that are read as if they were the usual ones."""


def holds_splats(path: Path) -> bool:
    """Whether a .glb has a primitive with the extension; otherwise it is a mesh.

    Raises InputError for what is no glTF.
    """
    return any(_is_splats(p) for p in _primitives(Document(path)))


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open a .glb with splats. Raises InputError for one without, or a damaged one."""
    document = Document(path)
    parts, others = _found(document), sum(not _is_splats(p) for p in _primitives(document))
    if not parts:
        raise InputError(
            f"{path} has no {EXTENSION} in its scene: it holds a mesh, "
            "export splats with that extension"
        )
    notes = [f"meshes and points left out: {others}"] * bool(others)
    if any(part.logarithmic for part in parts):
        notes.append(
            "negative scales: read as logarithms, as drafts of the extension and writers of 2025 "
            "had them"
        )
    notes += dict.fromkeys(note for part in parts for note in part.unusual)
    return SceneSource(
        path,
        f"glTF {EXTENSION}",
        _header(document, max(part.degree for part in parts)),
        sum(part.count for part in parts),
        partial(_blocks, parts),
        tuple(notes),
    )


def _header(document: Document, degree: int) -> SceneHeader:
    """With what gsedit notes beside the splats: comments, as of units and frames, and the mark of
    antialiased scenes."""
    extras = document.json["asset"].get("extras")
    noted = extras if isinstance(extras, dict) else {}
    told = noted.get("comments")
    comments = tuple(c for c in told if isinstance(c, str)) if isinstance(told, list) else ()
    return SceneHeader(degree, comments=comments, antialiased=noted.get("antialiased") is True)


def _noted(header: SceneHeader) -> dict[str, Any]:
    """The asset of a scene with this header."""
    comments = [c for c in header.comments if not c.startswith(PROGRAM)]
    extras = {"comments": comments} if comments else {}
    extras |= {"antialiased": True} if header.antialiased else {}
    return _SCENE["asset"] | ({"extras": extras} if extras else {})


def _is_splats(primitive: Any) -> bool:
    extensions = primitive.get("extensions") if isinstance(primitive, dict) else None
    return isinstance(extensions, dict) and EXTENSION in extensions


def _primitives(document: Document) -> Iterator[Any]:
    for mesh in document.items("meshes"):
        primitives = mesh.get("primitives", [])
        yield from primitives if isinstance(primitives, list) else ()


def _found(document: Document) -> list[_Splats]:
    """The splats of the scene, each as often as a node shows it."""
    nodes = document.items("nodes")
    if document.items("scenes"):
        roots = document.item("scenes", document.json.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in nodes for child in _children(node) if isinstance(child, int)}
        roots = [index for index in range(len(nodes)) if index not in below]
    parts: list[_Splats] = []
    stack = [(index, IDENTITY, 0) for index in reversed(roots if isinstance(roots, list) else [])]
    seen = 0
    while stack:
        index, above, depth = stack.pop()
        node, seen = document.item("nodes", index), seen + 1
        if depth > 100 or seen > len(nodes):
            raise InputError(f"{document.path}: its nodes go round in a circle: {AGAIN}")
        own = _placed(document, index, node)
        place = own if above is IDENTITY else above if own is IDENTITY else above.after(own)
        if "mesh" in node:
            mesh = document.item("meshes", node["mesh"])
            primitives = mesh.get("primitives", [])
            for each in primitives if isinstance(primitives, list) else ():
                if _is_splats(each):
                    parts.append(_splats(document, each, place))
        stack += [(child, place, depth + 1) for child in _children(node)]
    return parts


def _children(node: dict[str, Any]) -> list[Any]:
    children = node.get("children", [])
    return children if isinstance(children, list) else []


def _placed(document: Document, index: int, node: dict[str, Any]) -> Similarity:
    """Similarity of a node for its children. Raises InputError where splats cannot follow."""
    if not node.keys() & {"matrix", "rotation", "scale", "translation"}:
        return IDENTITY
    try:
        if "matrix" in node:  # column after column
            return similarity_of(np.array(node["matrix"], np.float64).reshape(4, 4).T)
        matrix = np.eye(4)
        x, y, z, w = map(float, node.get("rotation", (0, 0, 0, 1)))
        scale = np.array(node.get("scale", (1, 1, 1)), np.float64)
        if not 0 < abs(x) + abs(y) + abs(z) + abs(w) < np.inf:
            raise ValueError("its rotation is no quaternion")
        matrix[:3, :3] = rotation_of(np.array([w, x, y, z])) * scale
        matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64)
        return similarity_of(matrix)
    except (TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{document.path}: nodes[{index}] ({error}): export it again") from None


def _splats(document: Document, primitive: dict[str, Any], place: Similarity) -> _Splats:
    """The accessors of a primitive. Raises InputError where some are missing or of other lengths"""
    path, found = document.path, primitive.get("attributes")
    inner = primitive["extensions"][EXTENSION]
    if isinstance(inner, dict) and inner.get("extensions"):
        raise InputError(
            f"{path}: its splats are packed by {', '.join(map(str, inner['extensions']))[:80]}: "
            "export them without compression, or as .spz"
        )
    if not isinstance(found, dict):
        raise InputError(f"{path}: a primitive of splats has no attributes: {AGAIN}")
    degrees = [d for d in range(4) if any(name in found for name in _sh_names(d))]
    degree = max(degrees, default=0)
    kinds = {"POSITION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3", "OPACITY": "SCALAR"}
    kinds |= {n.partition(":")[2]: "VEC3" for d in range(degree + 1) for n in _sh_names(d)}
    attributes = {}
    for name, kind in kinds.items():
        full = name if name == "POSITION" else f"{EXTENSION}:{name}"
        if full not in found:
            raise InputError(f"{path}: its splats have no attribute {full}: export them again")
        attributes[name] = document.accessor(found[full], (kind,))
    counts = {accessor.count for accessor in attributes.values()}
    if len(counts) > 1:
        raise InputError(f"{path}: the attributes of its splats have {counts} rows: {AGAIN}")
    scales = attributes["SCALE"]
    some = scales.rows(0, min(counts.pop(), AT_ONCE)) if scales.count else np.zeros((0, 3))
    logarithmic = bool((some < 0).any())
    return _Splats(attributes, degree, scales.count, place, logarithmic, _unusual(inner))


def _unusual(about: Any) -> tuple[str, ...]:
    """A sentence on each word of an extension that promises another picture than ours."""
    told = about if isinstance(about, dict) else {}
    return tuple(
        f"{key} is {str(told[key])[:40]}: read as {_ABOUT[key]}, so it may look different"
        for key in ("kernel", "colorSpace")
        if told.get(key, _ABOUT[key]) != _ABOUT[key]
    )


def _sh_names(degree: int) -> list[str]:
    return [f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{n}" for n in range(2 * degree + 1)]


def _blocks(parts: list[_Splats]) -> Blocks:
    degree = max(part.degree for part in parts)
    for part in parts:
        for start in range(0, part.count, AT_ONCE):
            table = _rows(part, start, min(start + AT_ONCE, part.count), (degree + 1) ** 2)
            with np.errstate(invalid="ignore", over="ignore"):  # invalid rows are found later
                placed = table if part.place is IDENTITY else part.place.table(table)
            yield from_axes(placed, LUF)


def _rows(part: _Splats, start: int, stop: int, k: int) -> SplatTable:
    """Some rows along glTF's axes, SH filled up with zeros to k coefficients."""
    read = {name: each.rows(start, stop) for name, each in part.attributes.items()}
    sh = np.zeros((stop - start, k, 3), np.float32)
    names = [n.partition(":")[2] for d in range(part.degree + 1) for n in _sh_names(d)]
    for place, name in enumerate(names):
        sh[:, place] = read[name]
    scales = read["SCALE"]
    scales = scales if part.logarithmic else log_scales_of(scales)
    quats = np.roll(read["ROTATION"], 1, axis=1)
    return SplatTable(read["POSITION"], quats, scales, logits_of(read["OPACITY"][:, 0]), sh)


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write a .glb; the number of rows. Raises UsageError for one of more than 4 GB."""
    bounds = np.array([[np.inf] * 3, [-np.inf] * 3], np.float32)
    count = 0
    with ExitStack() as stack:
        files: dict[str, IO[bytes]] = {}
        for block in blocks:
            for name, values in _attributes(to_axes(block, LUF)).items():
                if name not in files:
                    files[name] = stack.enter_context(tempfile.TemporaryFile(dir=path.parent))
                values.tofile(files[name])
                if name == "POSITION" and len(values):
                    bounds[0] = np.fmin(bounds[0], np.fmin.reduce(values))
                    bounds[1] = np.fmax(bounds[1], np.fmax.reduce(values))
            count += len(block)
        if count:
            _assemble(path, files, count, bounds, _noted(header))
    return count


def _attributes(table: SplatTable) -> dict[str, np.ndarray]:
    """Arrays that the file holds for each row, C-contiguous, little-endian."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        quats = table.quats / np.linalg.norm(table.quats, axis=1, keepdims=True)
        color = np.column_stack((table.colors, table.opacities)) * 255
        color = np.rint(color).clip(0, 255).astype(np.uint8)
    values = {
        "POSITION": table.means,
        "COLOR_0": color,  # for viewers without splats
        f"{EXTENSION}:ROTATION": np.roll(quats, -1, axis=1),
        f"{EXTENSION}:SCALE": table.scales,
        f"{EXTENSION}:OPACITY": table.opacities,
    }
    names = [name for degree in range(table.degree + 1) for name in _sh_names(degree)]
    values |= {name: table.sh[:, i] for i, name in enumerate(names)}
    return {
        name: np.ascontiguousarray(each, "u1" if each.dtype == np.uint8 else "<f4")
        for name, each in values.items()
    }


def _assemble(
    path: Path,
    files: dict[str, IO[bytes]],
    count: int,
    bounds: Float32[np.ndarray, "2 3"],
    asset: dict[str, Any],
) -> None:
    """The JSON, then each attribute's bytes, which are multiples of four."""
    views, accessors, at = [], [], 0
    for name, file in files.items():
        size = file.seek(0, 2)
        views.append({"buffer": 0, "byteOffset": at, "byteLength": size, "target": _ARRAY_BUFFER})
        kind = {4: "SCALAR", 12: "VEC3", 16: "VEC4"}[size // count]
        about: dict[str, Any] = {"bufferView": len(views) - 1, "count": count}
        about |= {"componentType": _FLOAT, "type": kind}
        if name == "POSITION":
            about |= {"min": bounds[0].tolist(), "max": bounds[1].tolist()}
        if name == "COLOR_0":
            about |= {"componentType": _BYTE, "type": "VEC4", "normalized": True}
        accessors.append(about)
        at += size
    primitive = {
        "attributes": {name: index for index, name in enumerate(files)},
        "mode": _POINTS,
        "extensions": {EXTENSION: _ABOUT},
    }
    scene = _SCENE | {"asset": asset, "meshes": [{"primitives": [primitive]}]}
    scene |= {"buffers": [{"byteLength": at}], "bufferViews": views, "accessors": accessors}
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    length = GLB_HEADER.size + 2 * GLB_CHUNK.size + len(text) + at
    if length >= 1 << 32:
        raise UsageError(f"{path}: a .glb ends at 4 GB, the scene needs {length / 1e9:.1f}")
    with path.open("wb") as out:
        out.write(GLB_HEADER.pack(b"glTF", 2, length) + GLB_CHUNK.pack(len(text), b"JSON") + text)
        out.write(GLB_CHUNK.pack(at, b"BIN\0"))
        for file in files.values():
            file.seek(0)
            shutil.copyfileobj(file, out, 1 << 20)
