"""Niantic's .spz: versions 2 to 4 in, 3 out.

Versions 2 and 3 are one gzip stream: a header of 16 bytes, then attribute after attribute; version
4 is a header of 32 bytes, extensions, a table of sizes, and one zstd frame an attribute. Reading
holds the unpacked bytes (20 a Gaussian, 65 with SH degree 3) and one block; writing 12 more.
Source: github.com/nianticlabs/spz, README.md and extensions/README.md.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import partial
from math import floor, log2
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8

from gsedit.errors import InputError, UsageError
from gsedit.formats.axes import RDF, RUB, from_axes, to_axes
from gsedit.formats.limits import check_expansion
from gsedit.formats.quantised import from_smallest_three, logits_of, smallest_three
from gsedit.formats.streams import AT_ONCE, Blocks, ReadOptions, SceneHeader, SceneSource, in_blocks
from gsedit.scene.table import SplatTable

POSITION_BITS = 24
"""Positions are signed fixed-point numbers."""
_COLOR = 0.15
"""f_dc is stored as 0.5 + 0.15 f_dc: from -3.3 to 3.3."""
_SCALE_STEPS, _SCALE_START = 16, -10
"""Logarithms of scales: from -10 to 5.9 in steps of 1/16."""
_HALF_SQRT = 0.5**0.5
"""No component of a unit quaternion but the largest is above it."""
_BYTES = np.arange(256, dtype=np.float32)
MAGIC = 0x5053474E
"""First four bytes of the file: `NGSP`."""
FRACTIONAL_BITS = 12
"""Most fractional bits of a position: Niantic's default."""
_LARGEST = (1 << (POSITION_BITS - 1)) - 1
"""Largest coordinate, in its steps."""
FRAMES = {"rub": RUB, "rdf": RDF}
"""Coordinate frames that --spz-frame may name."""
_HEADER = struct.Struct("<IIIBBBB")
"""Magic, version, count, SH degree, fractional bits, flags; in version 4 the number of streams."""
_REST_OF_4 = struct.Struct("<I12x")
"""Rest of a version 4 header: offset of the table of sizes."""
_SIZES = struct.Struct("<QQ")
"""Sizes of a zstd frame: packed, unpacked."""
_EXTENSION = struct.Struct("<II")
"""Type, length; then the extension itself."""
_ANTIALIASED, _EXTENDED = 1, 2
"""Bits of the header's flags."""
_COORDINATE_SYSTEM = 0xADBE0003
"""Extension SPZ_ADOBE_coordinate_system: its four bytes are a place in _SYSTEMS."""
_SYSTEMS = (
    *("", "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF"),
    *("LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU"),
)
_PIECE = 1 << 20
"""Bytes unpacked at a time, and that may follow the attributes (extensions take a few hundred)."""
_AGAIN = "it is cut off or damaged, copy or export it again"


@dataclass(frozen=True)
class _Header:
    version: int
    count: int
    degree: int
    bits: int
    flags: int
    streams: int = 0
    """Number of streams in version 4."""
    sizes_at: int = 0
    """Byte at which the table of sizes begins, in version 4."""

    @property
    def widths(self) -> dict[str, int]:
        return widths(self.version, self.degree)

    @property
    def row_bytes(self) -> int:
        return sum(self.widths.values())


def open_source(path: Path, options: ReadOptions) -> SceneSource:
    """Open an .spz of version 2 to 4. Raises InputError for one whose header cannot be right."""
    with path.open("rb") as handle:
        start = handle.read(_PIECE)
    gzipped = start[:2] == b"\x1f\x8b"
    header = _read_header(path, _first_bytes(path, start) if gzipped else start, gzipped)
    check_expansion(path, path.stat().st_size, header.count * header.row_bytes)
    frame = FRAMES[options.spz_frame]
    notes = ()
    if not gzipped:
        named = _frame_of(path, start[_HEADER.size + _REST_OF_4.size : header.sizes_at], header)
        notes = (f"the file says that its axes are {named}",) if named not in ("", frame) else ()
        frame = named or frame
    return SceneSource(
        path,
        f".spz version {header.version}",
        SceneHeader(header.degree, antialiased=bool(header.flags & _ANTIALIASED)),
        header.count,
        partial(_blocks, path, header, frame),
        notes,
    )


def write(path: Path, header: SceneHeader, blocks: Blocks) -> int:
    """Write version 3, positions as fine as the scene's extent allows; the number of rows. Raises
    UsageError beyond 4e6 from the origin."""
    means: list[np.ndarray] = []
    packed: dict[str, list[np.ndarray]] = {name: [] for name in widths(3, header.degree)}
    for block in blocks:
        turned = to_axes(block, RUB)
        means.append(np.ascontiguousarray(turned.means, np.float32))
        for name, part in pack(turned).items():
            packed[name].append(part)
    count = sum(map(len, means))
    if not count:
        return 0
    bits = _fractional_bits(path, means)
    streams = {name: iter(parts) for name, parts in packed.items()}
    streams["positions"] = (pack_positions(part, bits) for part in means)
    deflate = zlib.compressobj(6, zlib.DEFLATED, 31)  # 31: with gzip's header and checksum
    with path.open("wb") as handle:
        fields = (3, count, header.degree, bits, _ANTIALIASED * header.antialiased, 0)
        handle.write(deflate.compress(_HEADER.pack(MAGIC, *fields)))
        for parts in streams.values():
            for part in parts:
                handle.write(deflate.compress(part.tobytes()))
        handle.write(deflate.flush())
    return count


def _fractional_bits(path: Path, means: list[np.ndarray]) -> int:
    """As many as leave room for the farthest coordinate."""
    parts = (np.abs(part[np.isfinite(part)]) for part in means)
    extent = max((float(part.max(initial=0)) for part in parts), default=0.0)
    bits = min(FRACTIONAL_BITS, floor(log2(_LARGEST / max(extent, 1e-6))))
    if bits < 1:
        raise UsageError(f"{path}: .spz holds positions up to 4e6, not {extent:.3g}: save a .ply")
    return bits


def _first_bytes(path: Path, start: bytes) -> bytes:
    """The header out of the beginning of a gzip stream."""
    try:
        return zlib.decompressobj(31).decompress(start, _HEADER.size)
    except zlib.error as error:
        raise InputError(f"{path} cannot be unpacked ({error}): {_AGAIN}") from None


def _read_header(path: Path, start: bytes, gzipped: bool) -> _Header:
    """Raises InputError where a field has a value that the format does not know."""
    whole = _HEADER.size + (0 if gzipped else _REST_OF_4.size)
    if len(start) < whole or start[:4] != b"NGSP":
        raise InputError(f"{path} is not an SPZ file: check the path, or export it again")
    _, version, count, degree, bits, flags, streams = _HEADER.unpack_from(start)
    if not (2 <= version <= 3 if gzipped else version == 4):
        raise InputError(f"{path} is SPZ version {version}: gsedit reads 2 to 4, export it again")
    if degree > 4 or bits >= POSITION_BITS:
        raise InputError(f"{path} has SH degree {degree} and {bits} fractional bits: {_AGAIN}")
    if gzipped:
        return _Header(version, count, degree, bits, flags)
    (sizes_at,) = _REST_OF_4.unpack_from(start, _HEADER.size)
    header = _Header(version, count, degree, bits, flags, streams, sizes_at)
    if not whole <= sizes_at <= len(start) - _SIZES.size * streams:
        raise InputError(f"{path}: its table of sizes is not where its header says: {_AGAIN}")
    if count and streams != len(header.widths):
        needed = len(header.widths)
        raise InputError(f"{path} has {streams} streams, degree {degree} needs {needed}: {_AGAIN}")
    return header


def _frame_of(path: Path, extensions: bytes, header: _Header) -> str:
    """The axes that an extension names, or "". Raises InputError for a damaged one."""
    at = 0
    while header.flags & _EXTENDED and at + _EXTENSION.size <= len(extensions):
        kind, length = _EXTENSION.unpack_from(extensions, at)
        at += _EXTENSION.size
        if kind == _COORDINATE_SYSTEM:
            value = int.from_bytes(extensions[at : at + 4], "little")
            if length != 4 or value >= len(_SYSTEMS):
                raise InputError(f"{path} names axes number {value}, which nobody knows: {_AGAIN}")
            return _SYSTEMS[value]
        at += length
    return ""


def _blocks(path: Path, header: _Header, frame: str) -> Blocks:
    if not header.count:
        return
    if header.version == 4:
        packed = _unpacked_4(path, header)
    else:
        data = _gunzipped(path, _HEADER.size + header.count * header.row_bytes)
        packed, at = {}, _HEADER.size
        for name, width in header.widths.items():
            size = width * header.count
            packed[name] = np.frombuffer(data, np.uint8, size, at).reshape(-1, width)
            at += size
        frame = _frame_of(path, bytes(data[at:]), header) or frame
    for start in range(0, header.count, AT_ONCE):
        some = {name: part[start : start + AT_ONCE] for name, part in packed.items()}
        yield from in_blocks(from_axes(unpack(some, header.version, header.bits), frame))


def _gunzipped(path: Path, size: int) -> bytearray:
    """The stream, whose checksum is right, of `size` bytes and what little follows them.

    It grows with what is there: a header may announce anything.
    """
    out, inflate = bytearray(), zlib.decompressobj(31)
    with path.open("rb") as handle:
        while len(out) < size or not inflate.eof:
            if inflate.eof:  # a stream of several members
                left, inflate = inflate.unused_data, zlib.decompressobj(31)
            else:
                left = inflate.unconsumed_tail
            left = left or handle.read(_PIECE)
            if not left:
                raise InputError(f"{path} ends after {len(out)} of {size} bytes: {_AGAIN}")
            try:
                out += inflate.decompress(left, _PIECE)
            except zlib.error as error:
                raise InputError(f"{path} cannot be unpacked ({error}): {_AGAIN}") from None
            if len(out) > size + _PIECE:
                raise InputError(f"{path} holds more than the {size} bytes it announces: {_AGAIN}")
    return out


def _unpacked_4(path: Path, header: _Header) -> dict[str, UInt8[np.ndarray, "n b"]]:
    """The bytes of each attribute of a version 4."""
    import zstandard

    packed = {}
    with path.open("rb") as handle:
        handle.seek(header.sizes_at)
        sizes = handle.read(_SIZES.size * header.streams)
        left = path.stat().st_size - handle.tell()
        for (name, width), (size, unpacked) in zip(
            header.widths.items(), _SIZES.iter_unpack(sizes)
        ):
            needed = width * header.count
            if unpacked != needed or size > left:
                raise InputError(f"{path}: the sizes of its {name} cannot be right: {_AGAIN}")
            left -= size
            frame = handle.read(size)
            try:
                told = zstandard.frame_content_size(frame)
                if told not in (-1, needed):  # -1: the frame does not say
                    raise zstandard.ZstdError("it holds another number of bytes")
                data = zstandard.ZstdDecompressor().decompress(frame, max_output_size=needed)
            except zstandard.ZstdError as error:
                raise InputError(
                    f"{path}: its {name} cannot be unpacked ({error}): {_AGAIN}"
                ) from None
            if len(data) != needed:
                raise InputError(f"{path}: its {name} end too early: {_AGAIN}")
            packed[name] = np.frombuffer(data, np.uint8).reshape(-1, width)
    return packed


def widths(version: int, degree: int) -> dict[str, int]:
    """Bytes a Gaussian of each attribute, in the order of the file."""
    sizes = {"positions": 9, "alphas": 1, "colors": 3, "scales": 3}
    sizes |= {"rotations": 3 if version < 3 else 4, "sh": 3 * ((degree + 1) ** 2 - 1)}
    return {name: size for name, size in sizes.items() if size}


def unpack(packed: dict[str, UInt8[np.ndarray, "n b"]], version: int, bits: int) -> SplatTable:
    """Gaussians from the bytes of `widths(version, degree)`, along the axes of the file.

    `bits` of a position are behind the point.
    """
    count = len(packed["alphas"])
    colors = ((_BYTES / 255 - np.float32(0.5)) / np.float32(_COLOR))[packed["colors"]]
    rest = packed.get("sh", np.empty((count, 0), np.uint8))
    sh = np.empty((count, 1 + rest.shape[1] // 3, 3), np.float32)
    sh[:, 0] = colors
    np.divide(rest.reshape(count, -1, 3), 128, out=sh[:, 1:], dtype=np.float32)
    sh[:, 1:] -= 1
    return SplatTable(
        means=_means(packed["positions"], bits),
        quats=(_smallest_three if version >= 3 else _first_three)(packed["rotations"]),
        log_scales=(_BYTES / _SCALE_STEPS + _SCALE_START)[packed["scales"]],
        logit_opacities=logits_of(_BYTES / 255)[packed["alphas"][:, 0]],
        sh=sh,
    )


def pack(table: SplatTable) -> dict[str, UInt8[np.ndarray, "n b"]]:
    """All attributes but the positions as bytes, of version 3 on. Values beyond a range stop at
    its end. SH with 8 bits, not the 5 and 4 of Niantic's writer, which only pack better."""
    with np.errstate(over="ignore"):  # damaged rows: told later
        attributes = {
            "alphas": _bytes((255 / (1 + np.exp(-table.logit_opacities)))[:, None]),
            "colors": _bytes((table.sh[:, 0] * np.float32(_COLOR) + np.float32(0.5)) * 255),
            "scales": _bytes((table.log_scales - _SCALE_START) * _SCALE_STEPS),
            "rotations": pack_rotations(table.quats),
        }
        if table.sh.shape[1] > 1:
            attributes["sh"] = _bytes((table.sh[:, 1:] + 1) * 128).reshape(len(table), -1)
    return attributes


def pack_positions(means: Float32[np.ndarray, "n 3"], bits: int) -> UInt8[np.ndarray, "n 9"]:
    """24 bits a coordinate, `bits` of them behind the point."""
    top = (1 << (POSITION_BITS - 1)) - 1
    with np.errstate(invalid="ignore"):
        fixed = np.rint(means.astype(np.float64) * (1 << bits)).clip(-top - 1, top).astype("<i4")
    return fixed.view(np.uint8).reshape(-1, 3, 4)[..., :3].reshape(-1, 9)


def pack_rotations(quats: Float32[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """The three smaller components of the unit quaternion, 9 bits and a sign each; the largest
    is positive, and its place among xyzw stands in the upper two bits."""
    others, largest = smallest_three(np.roll(quats, -1, axis=1))
    others = others[:, ::-1]  # the last one in the lowest bits
    with np.errstate(invalid="ignore"):
        sizes = np.rint(np.abs(others) * (511 / _HALF_SQRT)).clip(0, 511).astype(np.uint32)
    fields = (sizes | (others < 0).astype(np.uint32) << 9) << np.array([0, 10, 20], np.uint32)
    packed = np.bitwise_or.reduce(fields, axis=1) | largest.astype(np.uint32) << 30
    return packed.astype("<u4").view(np.uint8).reshape(-1, 4)


def _means(raw: UInt8[np.ndarray, "n b"], bits: int) -> Float32[np.ndarray, "n 3"]:
    padded = np.zeros((len(raw), 3, 4), np.uint8)
    padded[..., 1:] = raw.reshape(-1, 3, 3)
    fixed = padded.view("<i4")[..., 0] >> 8  # the shift keeps the sign
    return fixed.astype(np.float32) * np.float32(2.0**-bits)


def _first_three(raw: UInt8[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 4"]:
    xyz = raw.astype(np.float32) / np.float32(127.5) - 1
    w = np.sqrt((1 - (xyz * xyz).sum(1, keepdims=True)).clip(0))
    return np.concatenate((w, xyz), 1)


def _smallest_three(raw: UInt8[np.ndarray, "n 4"]) -> Float32[np.ndarray, "n 4"]:
    packed = np.ascontiguousarray(raw).view("<u4")
    largest = packed[:, 0] >> 30
    fields = packed >> np.array([0, 10, 20], np.uint32)
    others = (fields & 511).astype(np.float32) * np.float32(_HALF_SQRT / 511)
    others = np.where(fields & 512, -others, others)
    return np.roll(from_smallest_three(others[:, ::-1], largest), 1, axis=1)


def _bytes(values: np.ndarray) -> UInt8[np.ndarray, "..."]:
    with np.errstate(invalid="ignore"):
        return np.rint(values).clip(0, 255).astype(np.uint8)
