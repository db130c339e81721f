"""A seeded fuzzer of inputs: each damaged file gives a clear error or a valid result.

`python tests/fuzzing.py 2000` damages every input 2,000 times (make fuzz); those that a child
process reads, for half a second each, 40 times. `python tests/fuzzing.py 500 0 a.usdc session.json`
damages these two 500 times each, with seed 0.
"""

from __future__ import annotations

import gzip
import io
import json
import resource
import signal
import struct
import sys
import tempfile
import time
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zstandard
from PIL import Image

from gsedit.errors import GseditError
from gsedit.formats.files import open_scene
from gsedit.formats.validity import Guard

SECONDS = 5.0
"""CPU time that one file may take."""
Damage = Callable[[bytes, np.random.Generator], bytes]

NUMBERS = (b"0", b"-1", b"1e999", b"nan", b"1000000000000", b"4294967295", b"9" * 30, b"")
LEAVES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, -1e-320, 10**15, 2**31, "x", "", "../../etc/passwd", "/etc/passwd",
    "C:\\x", "\0", "data:,", "a" * 5000, [], {}, [None], [1e308] * 3, ["../x.webp"], [[]] * 300,
)  # fmt: skip


def cut(raw: bytes, rng: np.random.Generator) -> bytes:
    return raw[: rng.integers(len(raw))]


def flip(raw: bytes, rng: np.random.Generator) -> bytes:
    """Bits of up to eight bytes; half the time near the beginning, where headers are."""
    data = bytearray(raw)
    for _ in range(rng.integers(1, 9)):
        reach = min(len(data), 200) if rng.random() < 0.5 else len(data)
        data[rng.integers(reach)] ^= 1 << rng.integers(8)
    return bytes(data)


def absurd(raw: bytes, rng: np.random.Generator) -> bytes:
    """A count or a float that is none."""
    data = bytearray(raw)
    values = (0, 2**32 - 1, 2**31, 2**31 - 1, 2**40, 1, 0x7F800000, 0x7FC00000, 0xFF7FFFFF)
    word = struct.pack("<Q", int(rng.choice(values)))[: rng.choice((1, 2, 4, 8))]
    at = rng.integers(max(1, min(len(data), 400 if rng.random() < 0.5 else len(data))))
    data[at : at + len(word)] = word
    return bytes(data)


def splice(raw: bytes, rng: np.random.Generator) -> bytes:
    """A piece left out, doubled, or of noise."""
    a, b = sorted(rng.integers(0, len(raw) + 1, 2).tolist())
    b = min(b, a + 300)
    middle = (b"", raw[a:b] * 2, rng.bytes(b - a), bytes(b - a))[rng.integers(4)]
    return raw[:a] + middle + raw[b:]


def number(raw: bytes, rng: np.random.Generator) -> bytes:
    """A number in text, which may be anything but that."""
    digits = [i for i, c in enumerate(raw[:2000]) if 48 <= c <= 57]
    if not digits:
        return flip(raw, rng)
    start = end = digits[rng.integers(len(digits))]
    while start and 48 <= raw[start - 1] <= 57:
        start -= 1
    while end < len(raw) and 48 <= raw[end] <= 57:
        end += 1
    return raw[:start] + NUMBERS[rng.integers(len(NUMBERS))] + raw[end:]


BYTES: tuple[Damage, ...] = (cut, flip, flip, absurd, absurd, splice, number)


def any_bytes(raw: bytes, rng: np.random.Generator) -> bytes:
    return BYTES[rng.integers(len(BYTES))](raw, rng) if raw else rng.bytes(8)


def any_leaf(value: Any, rng: np.random.Generator) -> Any:
    """JSON with one value in it that should be another, or one missing."""
    value = json.loads(json.dumps(value))
    at = value
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        key = keys[rng.integers(len(keys))]
        inner = at[key]
        if isinstance(inner, dict | list) and inner and rng.random() < 0.85:
            at = inner
            continue
        if rng.random() < 0.15:
            del at[key]
        else:
            at[key] = LEAVES[rng.integers(len(LEAVES))]
        return value


def in_gzip(raw: bytes, rng: np.random.Generator) -> bytes:
    """Damage that the checksum does not show; sometimes a bomb."""
    inner = any_bytes(gzip.decompress(raw), rng)
    if rng.random() < 0.02:
        inner += bytes(1 << 23)
    return gzip.compress(inner, 1)


def in_zstd(raw: bytes, rng: np.random.Generator) -> bytes:
    """One stream of an .spz version 4, of another content or of another length."""
    streams, at = raw[15], int.from_bytes(raw[16:20], "little")
    sizes = [struct.unpack_from("<QQ", raw, at + 16 * i) for i in range(streams)]
    place, frames = at + 16 * streams, []
    for size, _ in sizes:
        frames.append(raw[place : place + size])
        place += size
    which = rng.integers(streams)
    inner = zstandard.ZstdDecompressor().decompress(frames[which])
    inner = bytes(1 << 24) if rng.random() < 0.05 else any_bytes(inner, rng)
    told = bool(rng.random() < 0.5)
    frames[which] = zstandard.ZstdCompressor(1, write_content_size=told).compress(inner)
    lengths = [(len(f), u) for f, (_, u) in zip(frames, sizes)]
    if rng.random() < 0.5:
        lengths[which] = (len(frames[which]), len(inner))
    table = b"".join(struct.pack("<QQ", *each) for each in lengths)
    return raw[:at] + table + b"".join(frames)


def in_zip(raw: bytes, rng: np.random.Generator) -> bytes:
    """A member that is damaged, renamed, missing, of a bomb or of another JSON."""
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    name = list(files)[rng.integers(len(files))]
    if "meta.json" in files and rng.random() < 0.5:
        name = "meta.json"
    files[name] = in_member(name, files[name], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for each, data in files.items():
            kind = rng.random() if each == name else 1.0
            if kind < 0.03:
                continue
            archive.writestr("../" + each if kind < 0.06 else each, data)
    return out.getvalue()


def in_member(name: str, data: bytes, rng: np.random.Generator) -> bytes:
    if name.endswith(".json") and rng.random() < 0.8:
        return json.dumps(any_leaf(json.loads(data), rng)).encode()
    kind = rng.random()
    if kind < 0.03:
        return bytes(1 << 23)
    if name.endswith(".webp") and kind < 0.3:
        return picture(rng)
    return any_bytes(data, rng)


def picture(rng: np.random.Generator) -> bytes:
    """A picture of another size or other values: sometimes giant and empty."""
    if rng.random() < 0.03:
        return giant()
    size = tuple(rng.integers(1, 30, 2).tolist())
    pixels = np.zeros((*size, 4), np.uint8) if rng.random() < 0.3 else None
    if pixels is None:
        pixels = rng.integers(0, 256, (*size, 4), dtype=np.uint8)
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, exact=True, method=0, quality=0)
    return out.getvalue()


@lru_cache(1)
def giant() -> bytes:
    """A picture of 64 MB in a few bytes."""
    out = io.BytesIO()
    pixels = np.zeros((4000, 4000, 4), np.uint8)
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, method=0, quality=0)
    return out.getvalue()


def in_glb(raw: bytes, rng: np.random.Generator) -> bytes:
    (length,) = struct.unpack_from("<I", raw, 12)
    text = json.dumps(any_leaf(json.loads(raw[20 : 20 + length]), rng)).encode()
    text += b" " * (-len(text) % 4)
    rest = raw[20 + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


def in_json(raw: bytes, rng: np.random.Generator) -> bytes:
    return json.dumps(any_leaf(json.loads(raw), rng)).encode()


@dataclass
class Outcome:
    """Counts and failures of the damaged files of one format."""

    valid: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)
    """Descriptions of failures, each with the number that repeats it."""
    slowest: float = 0.0
    """CPU seconds of the slowest file."""
    largest: int = 0
    """Bytes that Python held at the most, of one file."""


def judge(
    folder: Path,
    outcome: Outcome,
    label: str,
    limit: int,
    read: Callable[[Path], object],
    named: str = "",
    warned: Literal["error", "ignore"] = "error",
) -> None:
    """Read a folder and count how that ended: a message must name it, and the file `named` in it.
    Failures are other errors, and more than `limit` bytes or SECONDS. `warned`: what becomes of
    warnings."""
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    start = time.process_time()
    try:
        with warnings.catch_warnings(), _at_most(SECONDS):
            warnings.simplefilter(warned)
            read(folder)
        outcome.valid += 1
    except GseditError as error:
        outcome.refused += 1
        text = str(error)
        if str(folder / named) not in text or "\n" in text:
            outcome.failures.append(f"{label}: unclear: {text!r}")
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise
        outcome.failures.append(f"{label}: {type(error).__name__}: {error}")
    held = tracemalloc.get_traced_memory()[1] - before
    outcome.slowest = max(outcome.slowest, time.process_time() - start)
    outcome.largest = max(outcome.largest, held)
    if held > limit:
        outcome.failures.append(f"{label}: took {held >> 20} MiB")


def read_through(path: Path) -> None:
    """All rows, judged as every reader of a scene judges them. Raises GseditError."""
    source = open_scene(path)
    guard, rows = Guard(drop=False), 0
    for block in guard(source.blocks()):
        rows += len(block)
        k = (source.header.degree + 1) ** 2
        assert block.sh.shape == (len(block), k, 3)
        assert set(block.extra) == set(source.header.extra)
    guard.check(source.path)
    assert rows == source.count


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in a computation that takes longer."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {seconds} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def main(times: int, seed: int, names: list[str]) -> int:
    """Fuzz all inputs, or those named, say what happened; 1 if any failed."""
    from fuzz_inputs import INPUTS, fuzz  # which imports from here

    failed = 0
    tracemalloc.start()
    for subject in INPUTS:
        if names and subject.name not in names:
            continue
        start = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            outcome = fuzz(
                replace(subject, share=1.0) if names else subject, times, Path(folder), seed
            )
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        sys.stdout.write(
            f"{subject.name:18} {outcome.refused:5} refused {outcome.valid:5} valid "
            f"{len(outcome.failures):3} failed; slowest {outcome.slowest * 1e3:5.0f} ms, largest "
            f"{outcome.largest >> 20:3} MiB, process {peak} MiB, "
            f"{time.process_time() - start:.1f} s\n"
        )
        sys.stdout.writelines(f"  {failure}\n" for failure in outcome.failures[:10])
        failed += len(outcome.failures)
    return int(failed > 0)


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[1:] if each.isdigit()]
    named = [each for each in sys.argv[1:] if not each.isdigit()]
    times, seed = numbers + [2000, 0][len(numbers) :]
    sys.exit(main(times, seed, named))
