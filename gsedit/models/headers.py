"""Headers of safetensors files: whether a file is whole, and what is in it; no tensor is read.

A safetensors file is 8 bytes (the header's length, little-endian), the header (JSON: name -> dtype,
shape, data_offsets) and the data; its size follows from its header, so that a download that was cut
short is seen before gigabytes are loaded (github.com/huggingface/safetensors, "Format").
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

from gsedit.errors import InputError
from gsedit.storage.json_files import parse_json

LFS_POINTER = b"version https://git-lfs"
LONGEST_HEADER = 100_000_000  # bytes; the limit of the safetensors library itself
AGAIN = "download it again"


class Stored(NamedTuple):
    """A tensor as it is stored."""

    dtype: str
    """As the format names it: F32, F16, BF16, ..."""
    shape: tuple[int, ...]
    size: int
    """Bytes that it takes."""


def tensors(path: Path) -> dict[str, Stored]:
    """Tensors of a safetensors file that is as long as its header says.

    Raises InputError for one that is cut short, a Git LFS pointer, or no safetensors at all.
    """
    size, length, header = _read(path)
    try:
        entries = parse_json(header, path)
        entries.pop("__metadata__", None)
        stored = {name: _stored(entry) for name, entry in entries.items()}
        ends = [int(entry["data_offsets"][1]) for entry in entries.values()]
    except (InputError, ValueError, TypeError, KeyError, AttributeError, IndexError):
        raise InputError(f"{path} is no safetensors file: {AGAIN}") from None
    whole = 8 + length + max(ends, default=0)
    if size != whole:
        raise InputError(
            f"{path} has {_bytes(size)} of the {_bytes(whole)} that its header names: {AGAIN}"
        )
    return stored


def _read(path: Path) -> tuple[int, int, bytes]:
    """(size of the file, length of its header, the header)."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(8)
            if start + file.read(len(LFS_POINTER) - 8) == LFS_POINTER:
                raise InputError(f"{path} is a Git LFS pointer, not weights: run 'git lfs pull'")
            length = struct.unpack("<Q", start)[0] if len(start) == 8 else 0
            file.seek(8)
            cut = 8 + length > size
            header = b"" if cut or length > LONGEST_HEADER else file.read(length)
    except FileNotFoundError:
        raise InputError(f"{path} is missing: {AGAIN.removesuffix(' again')}") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): {AGAIN}") from error
    if size < 8 or (cut and length <= LONGEST_HEADER):
        raise InputError(f"{path} is cut short inside its header ({_bytes(size)}): {AGAIN}")
    return size, length, header


def _stored(entry: dict) -> Stored:
    first, last = entry["data_offsets"]
    return Stored(str(entry["dtype"]), tuple(entry["shape"]), last - first)


def _bytes(count: int) -> str:
    """A size for a person; exact below a megabyte, where a few bytes can matter."""
    return f"{count:,} bytes" if count < 1_000_000 else f"{count / 1e6:,.1f} MB"
