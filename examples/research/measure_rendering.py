"""Seconds a frame against resolution, and bytes and errors of every format that render writes.

    python -m research.measure_rendering bear.ply photos/ [--kernel torch]

The frames are a turntable by the photos' cameras; without photos, an orbit around the scene. Errors
are those of what is read back against the rendered float32 colors, clamped to [0, 1].
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from PIL import Image, ImageSequence

import gsedit
from gsedit.cameras.paths import camera_path
from gsedit.pictures.animations import write_gif, write_mp4
from gsedit.pictures.frames import Animation
from gsedit.pictures.maps import MapName, render_maps
from gsedit.pictures.rendered_views import write_still
from gsedit.scene.color_space import srgb_of_linear
from rasterizer import Camera, Execution, Gaussians
from research.exr import read_exr
from research.videos import read_frames

SIZES = (128, 256, 512, 1024)
SHOWN: dict[str, tuple[MapName, ...]] = {
    "color": ("color",), "with depth": ("color", "depth"), "with normals": ("color", "normals"),
}  # fmt: skip
Read = Callable[[Path], "np.ndarray"]
STILLS: dict[str, Read] = {
    ".png": lambda path: np.asarray(Image.open(path)) / 255,
    ".npy": np.load,
    ".exr": lambda path: srgb_of_linear(np.stack([read_exr(path)[name] for name in "RGB"], -1)),
}


def seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def speeds(scene: Gaussians, path: Sequence[Camera], execution: Execution, size: int) -> list[str]:
    """Pixels, then milliseconds a frame (median) of each kind of map, and of a wipe."""
    cameras = tuple(each.resized(size, round(size * each.height / each.width)) for each in path)
    kinds = [Animation(scene, cameras, show, execution=execution) for show in SHOWN.values()]
    kinds.append(Animation(scene, cameras, wiped=scene, execution=execution))
    row = [f"{size}x{cameras[0].height}"]
    for kind in kinds:
        times = [seconds(partial(kind.frame, index)) for index in range(len(path))]
        row.append(f"{1000 * median(times):.0f}")
    return row


def formats(scene: Gaussians, path: Sequence[Camera], execution: Execution) -> Iterator[list[str]]:
    """Format, bytes and milliseconds a frame to write, PSNR and largest error of what is read."""
    maps = [render_maps(scene, camera, execution=execution) for camera in path]
    exact = np.stack([each.color.clamp(0, 1).numpy() for each in maps])
    levels, count = [(each * 255).round().astype(np.uint8) for each in exact], len(path)

    def row(name: str, files: Sequence[Path], spent: float, found: np.ndarray) -> list[str]:
        error = found.clip(0, 1) - exact
        square = max(float((error**2).mean()), 1e-20)
        size = sum(file.stat().st_size for file in files) / count
        numbers = f"{size:,.0f}", f"{1000 * spent / count:.1f}", f"{-10 * np.log10(square):.1f}"
        return [name, *numbers, f"{float(np.abs(error).max()):.2g}"]

    with TemporaryDirectory() as folder:
        for suffix, read in STILLS.items():
            files = [Path(folder) / f"{index}{suffix}" for index in range(count)]
            spent = sum(
                seconds(partial(write_still, each, ("color",), file))
                for each, file in zip(maps, files)
            )
            yield row(suffix, files, spent, np.stack([read(file) for file in files]))
        for crf in (12, 18, 23, 28):
            file = Path(folder) / f"{crf}.mp4"
            spent = seconds(partial(write_mp4, levels, file, 30.0, crf=crf))
            found = np.stack(list(read_frames(file))) / 255
            yield row(f".mp4, crf {crf}", [file], spent, found)
        file = Path(folder) / "a.gif"
        spent = seconds(partial(write_gif, levels, file, 30.0))
        with Image.open(file) as picture:
            shown = [np.asarray(each.convert("RGB")) for each in ImageSequence.Iterator(picture)]
        yield row(".gif", [file], spent, np.stack(shown) / 255)


def table(rows: Iterable[Sequence[str]]) -> None:
    """Print rows of Markdown as they come, the first as the head."""
    for index, row in enumerate(rows):
        rule = "" if index else f"{'|---' * len(row)}|\n"
        sys.stdout.write(f"| {' | '.join(row)} |\n{rule}")
        sys.stdout.flush()


def main(words: Sequence[str], sizes: Sequence[int] = SIZES, frames: int = 30) -> None:
    by_torch = "--kernel" in words
    names = [word for word in words if word not in ("--kernel", "torch")]
    scene, execution = gsedit.load(names[0]), Execution(kernel="torch" if by_torch else "auto")
    if len(names) > 1:
        cameras = [view.camera for view in gsedit.load_dataset(names[1], size=sizes[0]).views]
    else:
        cameras = gsedit.orbit(scene, 24, sizes[0])
    path = camera_path("turntable", cameras, frames)
    render_maps(scene, path[0], execution=execution)  # compiles the kernel
    some = path[:: max(1, frames // 8)]
    head = ["ms a frame", *SHOWN, "wipe"]
    table(chain([head], (speeds(scene, some, execution, size) for size in sizes)))
    head = ["format", "bytes a frame", "ms to write", "PSNR, dB", "largest error"]
    side = sizes[len(sizes) // 2]
    sys.stdout.write("\n")
    table(chain([head], formats(scene, [c.resized(side, side) for c in path], execution)))


if __name__ == "__main__":
    main(sys.argv[1:])
