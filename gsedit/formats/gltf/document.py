"""A glTF 2.0 file as its JSON and its buffers: .glb in one piece, .gltf with files beside it.

What a file says of itself is compared with the bytes that are there before anything is read.
Source: registry.khronos.org/glTF/specs/2.0.
"""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.run.inputs import existing_file, file_inside
from gsedit.run.json_files import object_of, parse_json
from gsedit.run.safe_names import safe_name

GLB_HEADER = struct.Struct("<4sII")
"""Magic, version, length of the file."""
GLB_CHUNK = struct.Struct("<I4s")
"""Length, kind; then the chunk itself."""
AGAIN = "it is cut off or damaged, copy or export it again"
JSON_MAX_BYTES = 64 << 20
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
"""Number types that splats may have, by glTF's component type."""
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class _Buffer:
    """Bytes of a file from some place on, or in memory."""

    path: Path
    start: int
    length: int
    data: bytes | None = None

    def read(self, offset: int, size: int) -> bytes:
        if self.data is not None:
            return self.data[offset : offset + size]
        with self.path.open("rb") as handle:
            handle.seek(self.start + offset)
            return handle.read(size)


@dataclass(frozen=True)
class Accessor:
    """Values a row in a buffer, some bytes apart."""

    document: Document
    buffer: _Buffer
    offset: int
    stride: int
    count: int
    kind: np.dtype
    size: int
    """Number of values in a row."""
    normalized: bool

    def rows(self, start: int, stop: int) -> Float32[np.ndarray, "n c"]:
        """Some rows; normalised integers as their share of the largest."""
        row = self.kind.itemsize * self.size
        length = (stop - start - 1) * self.stride + row
        data = self.buffer.read(self.offset + start * self.stride, length)
        if len(data) < length:
            raise InputError(f"{self.document.path} became shorter while it was read: {AGAIN}")
        values = np.ndarray(
            (stop - start, self.size), self.kind, data, 0, (self.stride, self.kind.itemsize)
        ).astype(np.float32)
        if self.normalized and self.kind.kind in "iu":
            values = (values / np.iinfo(self.kind).max).clip(-1, 1)
        return values


class Document:
    """The JSON of a glTF file; every access checks what it finds."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for what is no glTF 2.0."""
        self.path = path
        with path.open("rb") as handle:
            start = handle.read(4)
        self.glb: _Buffer | None = None
        text = self._open_glb() if start == b"glTF" else self._read(path, 0, path.stat().st_size)
        self.json = parse_json(text, path, object_of({"asset": object_of({})}), advice=AGAIN)

    def _read(self, path: Path, start: int, size: int) -> bytes:
        if size > JSON_MAX_BYTES:
            raise InputError(f"{self.path} has {size / 1e6:.0f} MB of JSON: {AGAIN}")
        with path.open("rb") as handle:
            handle.seek(start)
            return handle.read(size)

    def _open_glb(self) -> bytes:
        """The JSON; notes where the buffer is."""
        size = self.path.stat().st_size
        with self.path.open("rb") as handle:
            header = handle.read(GLB_HEADER.size + GLB_CHUNK.size)
            if len(header) < GLB_HEADER.size + GLB_CHUNK.size:
                raise InputError(f"{self.path} ends within its header: {AGAIN}")
            _, version, _ = GLB_HEADER.unpack_from(header)
            length, kind = GLB_CHUNK.unpack_from(header, GLB_HEADER.size)
            if version != 2 or kind != b"JSON" or len(header) + length > size:
                raise InputError(f"{self.path} is no .glb of version 2, or cut off: {AGAIN}")
            at = len(header) + length
            handle.seek(at)
            chunk = handle.read(GLB_CHUNK.size)
        if len(chunk) == GLB_CHUNK.size:
            bytes_of_it, kind = GLB_CHUNK.unpack(chunk)
            at += GLB_CHUNK.size
            if kind == b"BIN\0":
                self.glb = _Buffer(self.path, at, min(bytes_of_it, size - at))
        return self._read(self.path, len(header), length)

    def item(self, name: str, index: Any) -> dict[str, Any]:
        """An entry of one of the lists at the top. Raises InputError where there is none."""
        items = self.json.get(name)
        found = items[index] if _is_index(index, items) else None
        if not isinstance(found, dict):
            raise InputError(f"{self.path} has no {name}[{index!r}]: {AGAIN}")
        return found

    def items(self, name: str) -> list[dict[str, Any]]:
        """One of the lists at the top; empty where there is none."""
        items = self.json.get(name, [])
        if not isinstance(items, list) or not all(isinstance(each, dict) for each in items):
            raise InputError(f"{self.path}: {name} is no list of objects: {AGAIN}")
        return items

    def integer(self, where: str, value: Any, least: int = 0) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 1 << 48:
            raise InputError(f"{self.path}: {where} is {value!r}, no sensible number: {AGAIN}")
        return value

    def accessor(self, index: Any, kinds: tuple[str, ...]) -> Accessor:
        """Find the values of an accessor. Raises InputError where they are not in the file."""
        where = f"accessors[{index!r}]"
        found = self.item("accessors", index)
        if "sparse" in found or "bufferView" not in found:
            raise InputError(f"{self.path}: {where} is sparse or empty: export the splats plainly")
        shape, component = found.get("type"), found.get("componentType")
        if shape not in kinds or not isinstance(component, int) or component not in _COMPONENTS:
            raise InputError(
                f"{self.path}: {where} is {str(shape)[:20]} of {str(component)[:20]}, not "
                f"{' or '.join(kinds)} of floats or normalised integers: export it again"
            )
        view = self.item("bufferViews", found["bufferView"])
        buffer = self._buffer(view.get("buffer"))
        kind, size = np.dtype(_COMPONENTS[component]), _SIZES[str(shape)]
        row = kind.itemsize * size
        count = self.integer(f"{where}.count", found.get("count"))
        stride = self.integer(f"{where}'s byteStride", view.get("byteStride", row), row)
        inner = self.integer(f"{where}.byteOffset", found.get("byteOffset", 0))
        offset = self.integer(f"{where}'s view", view.get("byteOffset", 0))
        length = self.integer(f"{where}'s view", view.get("byteLength"))
        needed = inner + (count - 1) * stride + row if count else 0
        if needed > length or offset + length > buffer.length:
            raise InputError(
                f"{self.path}: {where} promises {count} rows, more than its buffer has: {AGAIN}"
            )
        normalized = found.get("normalized") is True
        return Accessor(self, buffer, offset + inner, stride, count, kind, size, normalized)

    def _buffer(self, index: Any) -> _Buffer:
        uri = self.item("buffers", index).get("uri")
        if uri is None and index == 0 and self.glb is not None:
            return self.glb
        if not isinstance(uri, str):
            raise InputError(f"{self.path}: buffers[{index}] has no bytes: {AGAIN}")
        if uri.startswith("data:"):
            try:
                data = base64.b64decode(uri.partition(",")[2], validate=True)
            except (binascii.Error, ValueError):
                raise InputError(f"{self.path}: buffers[{index}] is no base64: {AGAIN}") from None
            return _Buffer(self.path, 0, len(data), data)
        try:
            name = safe_name(unquote(uri), str(self.path))
            file = existing_file(file_inside(self.path.parent, name, str(self.path)))
        except InputError as error:
            raise InputError(f"{self.path} names a file: {error}") from None
        return _Buffer(file, 0, file.stat().st_size)


def _is_index(index: Any, items: Any) -> bool:
    return (
        isinstance(index, int)
        and not isinstance(index, bool)
        and isinstance(items, list)
        and 0 <= index < len(items)
    )
