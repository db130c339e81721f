"""How long gsedit and splat-transform take for a large scene, and how much memory.

Makes a synthetic .ply, runs the same commands of both in turn, prints a table as Markdown, and
deletes what it wrote:

    python -m research.streaming_bench /tmp/big --count 10000000 --degree 3 \
        --splat-transform node_modules/.bin/splat-transform
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gsedit.formats.registry import write_scene
from gsedit.formats.streams import SceneHeader
from gsedit.scene.table import SplatTable
from research.clocked import clocked, must

AT_ONCE = 1 << 18


def blocks(count: int, degree: int) -> Iterator[SplatTable]:
    """Gaussians of a plausible scene: a dense core, a wide background, few opaque ones."""
    for start in range(0, count, AT_ONCE):
        rng = np.random.default_rng(start)
        n = min(AT_ONCE, count - start)

        def normal(*shape: int, rng: np.random.Generator = rng) -> np.ndarray:
            return rng.standard_normal(shape, np.float32)

        distance = np.exp(normal(n, 1))
        means = normal(n, 3) * distance
        sh = normal(n, (degree + 1) ** 2, 3) / 4
        yield SplatTable(means, normal(n, 4), normal(n, 3) - 4, 2 * normal(n), sh)


def jobs(scene: Path, folder: Path, splat_transform: str | None) -> list[tuple[str, list[str]]]:
    """The commands, those of the two programs beside each other."""
    ours = [sys.executable, "-m", "gsedit_cli"]
    made = [("gsedit info", [*ours, "info", str(scene)])]
    for suffix in ("ply", "compressed.ply", "spz"):
        out = str(folder / f"out.{suffix}")
        keep = ["--where", "opacity >= 0.1", "then", "convert", out, "-f"]
        made.append((f"gsedit convert .{suffix}", [*ours, "convert", str(scene), out, "-f"]))
        made.append((f"gsedit filter, convert .{suffix}", [*ours, "filter", str(scene), *keep]))
        if splat_transform:
            theirs = [splat_transform, "-w", str(scene)]
            made.append((f"splat-transform .{suffix}", [*theirs, out]))
            value = [*theirs, "-V", "opacity,gt,0.1", out]
            made.append((f"splat-transform -V .{suffix}", value))
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=10_000_000)
    parser.add_argument("--degree", type=int, default=3)
    parser.add_argument("--splat-transform", metavar="PROGRAM")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--only", default="", help="Words that a command's name must contain.")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    scene = options.folder / f"synthetic_{options.count}_sh{options.degree}.ply"
    if not scene.exists():
        write_scene(scene, SceneHeader(options.degree), blocks(options.count, options.degree))
    gigabytes = scene.stat().st_size / 1e9
    print(f"{options.count:,} Gaussians, SH {options.degree}: {gigabytes:.2f} GB")  # noqa: T201
    print("| command | s | peak MB |\n|---|---|---|")  # noqa: T201
    for _ in range(options.rounds):
        for name, words in jobs(scene, options.folder, options.splat_transform):
            if options.only in name:
                ran = must(clocked(*words), name)
                print(f"| {name} | {ran.seconds:.1f} | {1000 * ran.gigabytes:.0f} |", flush=True)  # noqa: T201
    for path in options.folder.glob("out.*"):
        path.unlink()


if __name__ == "__main__":
    main()
