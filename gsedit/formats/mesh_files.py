"""Meshes and point clouds as trimesh reads them, with what their files may name beside them."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from gsedit.errors import GseditError, InputError
from gsedit.formats.gltf.document import Document
from gsedit.formats.limits import MAX_POSITION, check_expansion
from gsedit.formats.pictures import check_picture
from gsedit.run.inputs import file_inside, open_regular


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
