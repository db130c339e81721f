"""Costs of a round trip through each format: PSNR of a picture, and bytes a Gaussian.

Each scene is written in every format that can be read again, in one part, and read; the picture is
256 pixels wide, from an orbit, of all rows. Prints a table as Markdown:

    python -m research.round_trips ../shared/data/splats/*.splat bear.ply
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from torch import Tensor

from gsedit import orbit, render
from gsedit.formats.registry import FORMATS, USD, open_scene, write_scene
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.measures.metrics import psnr
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.toolkit.reduce_sh import ReduceSH
from gsedit.toolkit.streamed import write_streamed
from rasterizer.camera import Camera

SIZE = 256
STREAMED = "streamed SOG, one level"
_EXACT = (".ply", ".npz")


def names() -> list[str]:
    """Formats that are written and read, those that keep every bit left out."""
    both = [each.suffix for each in FORMATS if each.writes]
    without = {*_EXACT, ".usd", *([] if find_spec("pxr") else USD)}
    return [name for name in both if name not in without] + [STREAMED]


def written(name: str, table: SplatTable, folder: Path) -> Path:
    """The scene in a format; what to open."""
    if name == STREAMED:
        write_streamed(folder / "lod", [ReduceSH(3).apply(table)], antialiased=False)
        return folder / "lod"
    most = next(each.max_degree for each in FORMATS if each.suffix == name)
    least = ReduceSH(most).apply(table)
    write_scene(folder / f"a{name}", SceneHeader(least.degree), in_blocks(least))
    return folder / f"a{name}"


def picture(table: SplatTable, camera: Camera) -> Tensor:
    return render(gaussians_of(table), camera).color.clamp(0, 1)


def cells(path: Path) -> Iterator[str]:
    """The row of the table for one scene."""
    table = open_scene(path).table()
    name = path.parent.name if path.name == "meta.json" else path.name
    yield f"{name} ({len(table):,}, {table.degree})"
    camera = orbit(gaussians_of(table), 4, SIZE)[1]
    shown = picture(table, camera)
    for each in names():
        with tempfile.TemporaryDirectory() as folder:
            file = written(each, table, Path(folder))
            files = [f for f in file.rglob("*") if f.is_file()] if file.is_dir() else [file]
            size = sum(f.stat().st_size for f in files) / len(table)
            found = float(psnr(picture(open_scene(file).table(), camera), shown))
            yield f"{found:.0f} dB, {size:.1f} B"


def main(scenes: list[Path]) -> None:
    """Print a row of the table for each scene."""
    heads = ["file (rows, SH degree)", *names()]
    sys.stdout.write("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|\n")
    for scene in scenes:
        sys.stdout.write("| " + " | ".join(cells(scene)) + " |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    main(parser.parse_args().scenes)
