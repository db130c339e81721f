"""Absurd expressions, sentences, sizes, outputs and regions on a command line."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hostile_cases.base import (
    EDIT,
    Case,
    Words,
    a_scene,
    saved,
)
from hostile_cases.datasets import FIT, photos_with


def expressions() -> Iterator[Case]:
    """Filter by expressions that are long, deep, or mean to run something."""
    texts = (
        "__import__('os').system('touch x')", "().__class__", "opacity > ", "(" * 500, "1/0 > x",
        "opacity > 1e999", "x" * 5000, "not " * 2000 + "x > 0", "x > 0 and " * 500 + "x > 0",
        "lambda: 0", "[i for i in x]", "f'{x}'", "x ** 1e9 > 0", "exec('1')", "\0", "", " ", "\n",
        "near('a')", "near(0,0,0)", "nan > x", "x > 'a'", "box(1,2)", "sphere(0,0,0,nan)", "True",
        "." * 50_000, "1." * 30_000, "near('" + "a" * 100_000 + "')", "x > 9" + "9" * 5000,
        "caf\u00e9 > 1", "x = 1", "x > 0; y", "opacity > 0.5 # x", "\x1b[31m > 1",
    )  # fmt: skip
    for text in texts:
        words: Words = ["filter", "scene.ply", "--where", text, "-o", "out/f.ply"]
        yield Case("--where", repr(text[:30]), lambda a, w=words: saved(a, a_scene(), w))


def sentences() -> Iterator[Case]:
    """Ask for looks in sentences that are none."""
    texts = ("", " ", "a\nb", "a\tb", "x" * 100_000, "\U0001f600" * 50, "\u202eabc", "\x1b]0;t\x07",
             "{}", "%s%n", "$(touch x)", "`touch x`", "'; drop", "\0", "\ud800", "-f", "--help",
             "gold " * 2000)  # fmt: skip
    for text in texts:
        yield Case("sentence", repr(text[:20]), lambda _, t=text: ["list", "looks", "--", t])


def old_verbs() -> Iterator[Case]:
    """Use verbs and options of earlier versions, which are refused with today's."""
    words: tuple[Words, ...] = (
        ["check", "scene.ply"], ["repair", "scene.ply", "-o", "out/r.ply"], ["editors"],
        ["recover", "out/e", "-o", "out/s.ply"], ["preview", "scene.ply", "-o", "out/p.png"],
        ["looks", "--", "gold"], ["settings", "edit"], ["crop", "scene.ply", "--box", "-1,x"],
        ["order", "scene.ply", "--by"], ["reduce-sh", "scene.ply", "--degree", "$(touch x)"],
        ["lod", "scene.ply", "--share"], ["remove-background", "scene.ply", "--grow"],
        ["filter", "scene.ply", "--box", "\x1b]0;title\x07", "-o", "out/f.ply"],
        ["filter", "scene.ply", "--near-color", "a'b\n@1,2", "--invert", "-o", "out/f.ply"],
        ["filter", "scene.ply", "--where", "x > 0", "--largest", "9" * 5000, "-o", "out/f.ply"],
        ["edit", "scene.ply", "as gold", "--no-plan", "-o", "out/e"],
    )  # fmt: skip
    for each in words:
        name = " ".join(each)[:40]
        yield Case("old verb", repr(name), lambda a, w=each: saved(a, a_scene(), w))


def full_disks() -> Iterator[Case]:
    """Write to a disk that is full sooner or later."""
    edited: Words = ["edit", "scene.ply", "as gold", *EDIT, "--checkpoint-every", 0, "-o", "out/e"]
    drawn: Words = ["render", "scene.ply", "--size", 64, "--count", 2]
    kinds: dict[str, tuple[Words, tuple[int, ...]]] = {
        "edit": (edited, (8, 64, 200, 400, 800)),
        "fit": ([*FIT, "--checkpoint-every", 0], (8, 64, 400, 800, 1600)),
        "render png": ([*drawn, "-o", "out/r"], (4, 12)),
        "render exr": ([*drawn, "--format", "exr", "-o", "out/r"], (4, 64)),
        "render npy": ([*drawn, "--format", "npy", "-o", "out/r"], (4, 64)),
        "render mp4": ([*drawn[:4], "--frames", 4, "-o", "out/r.mp4"], (4,)),
        "render gif": ([*drawn[:4], "--frames", 4, "-o", "out/r.gif"], (4,)),
        "view html": (["view", "scene.ply", "-o", "out/v.html"], (64, 400)),
        "select": (["select", "scene.ply", "--where", "x > 0", "-o", "out/s.npy"], (0,)),
        "plot": (["info", "scene.ply", "--plot", "out/p.png"], (4,)),
        **{end: (["convert", "scene.ply", f"out/c.{end}"], (4, 8)) for end in (
            "ply", "compressed.ply", "spz", "sog", "splat", "glb", "npz")},
    }  # fmt: skip
    for name, (words, sizes) in kinds.items():
        for size in sizes:
            yield Case("full disk", f"{name}, {size} kB",
                       lambda a, w=words: with_photos(a, w), disk=(size << 10) or 1)  # fmt: skip


def with_photos(arena: Path, words: Words) -> Words:
    """Write a scene of 1,000 Gaussians and nine photos."""
    photos_with(lambda _: None)(arena)
    (arena / "out").mkdir()
    return saved(arena, a_scene(count=1000), words)


def sizes() -> Iterator[Case]:
    """Edit and render at small and absurd sizes, seeds and counts."""
    for size in (-1, 0, 1, 2, 8, 15, 16, 17, 24, 31, 32, 33, 48, 60, 62, 63, 64):
        edited: Words = ["edit", "scene.ply", "turn it into gold", *EDIT, "--size", size]
        snow: Words = ["edit", "scene.ply", "make it snow", *EDIT, "--size", size]
        for name, words in (("gold", edited), ("snow", snow)):
            yield Case("size", f"edit {name} {size}",
                       lambda a, w=words: saved(a, a_scene(), [*w, "-o", "out/e"]))  # fmt: skip
        drawn: Words = ["render", "scene.ply", "--count", 1, "--size", size, "-o", "out/r"]
        yield Case("size", f"render {size}", lambda a, w=drawn: saved(a, a_scene(), w))
    for option, value in (
        ("--seed", 2**70), ("--seed", -1), ("--seed", "x"), ("--views", 0), ("--views", 10**9),
        ("--batches", 0), ("--set", "update_steps=-1"), ("--threads", 0), ("--threads", 10**6),
        ("--region", "box:1"), ("--region", "sphere:0,0,0,nan"), ("--region", "nothing.npy"),
        ("--region", "box:0,0,0,1e308,1e308,1e308"), ("--data", "nowhere"), ("--editor", "../x"),
    ):  # fmt: skip
        own = "process" if option == "--threads" else ""
        words = ["edit", "scene.ply", "turn it into gold", *EDIT, option, value, "-o", "out/e"]
        yield Case("option", f"{option} {str(value)[:12]}",
                   lambda a, w=words: saved(a, a_scene(), w), apart=own)  # fmt: skip
    for value in ("0x0", "-1x5", "1x1", "99999999x1", "axb", "1x", "1e3x5"):
        words = ["render", "scene.ply", "--count", 1, "--resolution", value, "-o", "out/r"]
        yield Case("option", f"--resolution {value}", lambda a, w=words: saved(a, a_scene(), w))
    for value in ("nan,0,0", "1e308,0,0", "0,0,0", "1e20,1e20,1e20", "a,b,c", "1,2"):
        words = ["render", "scene.ply", "--count", 1, "--size", 16, "--from", value, "-o", "out/r"]
        yield Case("option", f"--from {value}", lambda a, w=words: saved(a, a_scene(), w))


def outputs() -> Iterator[Case]:
    """Write to names that are no files, exist, or lead elsewhere."""
    names = ("out/a**b.ply", "out/[x].ply", "out/a?.ply", "out/" + "a" * 250 + ".ply",
             "out/a\nb.ply",
             "out", "out/", "", ".", "scene.ply", "out/none/x/y.ply", "out/x.txt", "out/x",
             "/dev/null", "/dev/full", "/proc/x.ply", "out/\x1b[31m.ply", "out/a b.ply",
             "out/nul.ply/x",
             "out/loop.ply", "out/dangling.ply", "out/" + "d/" * 200 + "x.ply")  # fmt: skip
    for name in names:
        words: dict[str, Words] = {
            "filter": ["filter", "scene.ply", "--where", "opacity > 0.1", "-o", name],
            "edit": ["edit", "scene.ply", "as gold", *EDIT, "-o", name],
        }
        for verb, each in words.items():
            yield Case(f"output {verb}", repr(name[:24]), lambda a, w=each: _output(a, w))


def _output(arena: Path, words: Words) -> Words:
    (arena / "out").mkdir()
    os.symlink("loop.ply", arena / "out/loop.ply")
    os.symlink("missing.ply", arena / "out/dangling.ply")
    return saved(arena, a_scene(), words)


def flags() -> Iterator[Case]:
    """Give regions that are no flags of this scene."""
    arrays: dict[str, bytes | np.ndarray] = {
        "other length": np.ones(7, bool), "floats": np.ones(200), "two columns": np.ones((200, 2)),
        "none": np.zeros(200, bool), "empty": b"", "text": b"x" * 200,
        "1e14 rows": _npy("(100000000000000,)"), "objects": _npy("(200,)", "|O"),
        "negative": _npy("(-1,)"), "code": _npy("__import__('os').system('touch x')"),
    }  # fmt: skip
    for name, array in arrays.items():
        for words in (
            ["filter", "scene.ply", "--region", "region.npy", "-o", "out/f.ply"],
            ["edit", "scene.ply", "as gold", *EDIT, "--region", "region.npy", "-o", "out/e"],
        ):
            yield Case("region.npy", f"{name} {words[0]}",
                       lambda a, d=array, w=words: _region(a, d, w))  # fmt: skip


def _npy(shape: str, kind: str = "|b1") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + b"\x01" * 200


def _region(arena: Path, data: bytes | np.ndarray, words: Words) -> Words:
    path = arena / "region.npy"
    path.write_bytes(data) if isinstance(data, bytes) else np.save(path, data)
    return saved(arena, a_scene(), words)


def headers() -> Iterator[Case]:
    """Read .ply files whose headers are long, lie, or speak to the terminal."""
    vertex = "".join(f"property float {c}\n" for c in "xyz")
    start, end = "ply\nformat binary_little_endian 1.0\n", "end_header\n"
    elements = "".join(f"element e{i} 0\nproperty int a\n" for i in range(20_000))
    columns = "".join(f"property float c{i}\n" for i in range(30_000))
    texts = {
        "20,000 elements": f"{start}{elements}element vertex 0\n{vertex}{end}",
        "30,000 columns": f"{start}element vertex 0\n{vertex}{columns}{end}",
        "count 1e18": f"{start}element vertex {10**18}\n{vertex}{end}",
        "count long": f"{start}element vertex {'9' * 5000}\n{vertex}{end}",
        "title": f"{start}comment \x1b]0;owned\x07\nelement vertex 0\n{vertex}{end}",
        "colored column": f"{start}element vertex 1\nproperty float \x1b[31mx\n{end}",
        "column twice": f"{start}element vertex 1\n{vertex}{vertex}{end}",
        "no end": f"{start}element vertex 1\n{vertex}",
    }
    for name, text in texts.items():
        for verb, more in (
            ("info", []), ("info", ["--check"]),
            ("render", ["--size", 16, "--count", 1, "-o", "out/r"]),
        ):  # fmt: skip
            words: Words = [verb, "scene.ply", *more]
            yield Case(
                ".ply header", f"{name} {verb} {' '.join(map(str, more[:1]))}",
                lambda a, t=text, w=words: _ply(a, t, w),
            )  # fmt: skip


def _ply(arena: Path, text: str, words: Words) -> Words:
    (arena / "scene.ply").write_bytes(text.encode() + b"\0" * 12)
    return words
