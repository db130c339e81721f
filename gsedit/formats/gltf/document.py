"""A glTF 2.0 file in one piece (.glb) as its JSON and its buffer.

What a file says of itself is compared with the bytes that are there before anything is read.
Source: registry.khronos.org/glTF/specs/2.0.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.run.json_files import object_of, parse_json

GLB_HEADER = struct.Struct("<4sII")
"""Magic, version, length of the file."""
GLB_CHUNK = struct.Struct("<I4s")
"""Length, kind; then the chunk itself."""
AGAIN = "it is cut off or damaged, copy or export it again"
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
"""Number types that splats may have, by glTF's component type."""
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class Accessor:
    """Values a row in the buffer, some bytes apart."""

    document: Document
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
        data = self.document.read(self.offset + start * self.stride, length)
        if len(data) < length:
            raise InputError(f"{self.document.path} became shorter while it was read: {AGAIN}")
        values = np.ndarray(
            (stop - start, self.size), self.kind, data, 0, (self.stride, self.kind.itemsize)
        ).astype(np.float32)
        if self.normalized and self.kind.kind in "iu":
            values = (values / np.iinfo(self.kind).max).clip(-1, 1)
        return values


class Document:
    """The JSON of a .glb and its buffer; every access checks what it finds."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for what is no glTF 2.0 in one piece."""
        self.path = path
        size = path.stat().st_size
        with path.open("rb") as handle:
            header = handle.read(GLB_HEADER.size + GLB_CHUNK.size)
            if len(header) < GLB_HEADER.size + GLB_CHUNK.size:
                raise InputError(f"{path} ends within its header: {AGAIN}")
            magic, version, _ = GLB_HEADER.unpack_from(header)
            length, kind = GLB_CHUNK.unpack_from(header, GLB_HEADER.size)
            at = len(header) + length
            if (magic, version, kind) != (b"glTF", 2, b"JSON") or at > size:
                raise InputError(f"{path} is no .glb of version 2, or cut off: {AGAIN}")
            if length > 64 << 20:
                raise InputError(f"{path} has {length / 1e6:.0f} MB of JSON: {AGAIN}")
            text, chunk = handle.read(length), handle.read(GLB_CHUNK.size)
        self.buffer = range(0)
        """Bytes of the file that are its buffer."""
        if len(chunk) == GLB_CHUNK.size:
            length, kind = GLB_CHUNK.unpack(chunk)
            at += GLB_CHUNK.size
            if kind == b"BIN\0":
                self.buffer = range(at, min(at + length, size))
        self.json = parse_json(text, path, object_of({"asset": object_of({})}), advice=AGAIN)

    def read(self, offset: int, size: int) -> bytes:
        """Bytes of the buffer."""
        with self.path.open("rb") as handle:
            handle.seek(self.buffer.start + offset)
            return handle.read(size)

    def item(self, name: str, index: Any) -> dict[str, Any]:
        """An entry of one of the lists at the top. Raises InputError where there is none."""
        items = self.json.get(name)
        listed = isinstance(items, list) and type(index) is int and 0 <= index < len(items)
        found = items[index] if listed else None
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
        buffer = self.item("buffers", view.get("buffer"))
        if "uri" in buffer or view["buffer"] != 0:
            raise InputError(f"{self.path} names another file for its bytes: export it as one .glb")
        kind, size = np.dtype(_COMPONENTS[component]), _SIZES[str(shape)]
        row = kind.itemsize * size
        count = self.integer(f"{where}.count", found.get("count"))
        stride = self.integer(f"{where}'s byteStride", view.get("byteStride", row), row)
        inner = self.integer(f"{where}.byteOffset", found.get("byteOffset", 0))
        offset = self.integer(f"{where}'s view", view.get("byteOffset", 0))
        length = self.integer(f"{where}'s view", view.get("byteLength"))
        needed = inner + (count - 1) * stride + row if count else 0
        if needed > length or offset + length > len(self.buffer):
            raise InputError(
                f"{self.path}: {where} promises {count} rows, more than its buffer has: {AGAIN}"
            )
        normalized = found.get("normalized") is True
        return Accessor(self, offset + inner, stride, count, kind, size, normalized)
