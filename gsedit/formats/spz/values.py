"""The values of Niantic's .spz, attribute by attribute: what its bytes mean, both ways.

Source: github.com/nianticlabs/spz, README.md and src/cc/load-spz.cc. `n` Gaussians, `b` bytes each.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from gsedit.formats.quantised import from_smallest_three, logits_of, smallest_three
from gsedit.scene.table import SplatTable

POSITION_BITS = 24
"""Positions are signed fixed-point numbers, from version 2 on."""
_COLOR = 0.15
"""f_dc is stored as 0.5 + 0.15 f_dc: from -3.3 to 3.3."""
_SCALE_STEPS, _SCALE_START = 16, -10
"""Logarithms of scales: from -10 to 5.9 in steps of 1/16."""
_HALF_SQRT = 0.5**0.5
"""No component of a unit quaternion but the largest is above it."""
_BYTES = np.arange(256, dtype=np.float32)


def widths(version: int, degree: int) -> dict[str, int]:
    """Bytes a Gaussian of each attribute, in the order of the file."""
    sizes = {"positions": 6 if version == 1 else 9, "alphas": 1, "colors": 3, "scales": 3}
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
        means=_means(packed["positions"], version, bits),
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


def _means(raw: UInt8[np.ndarray, "n b"], version: int, bits: int) -> Float32[np.ndarray, "n 3"]:
    if version == 1:
        return np.ascontiguousarray(raw).view("<f2").astype(np.float32)
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
