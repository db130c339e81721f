"""Levels of detail of a scene, a file each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_message

if TYPE_CHECKING:
    from gsedit.formats.streams import SceneHeader
    from gsedit.scene.table import SplatTable

    from ..options.files import FileOptions


@dataclass(frozen=True)
class Levels:
    """Levels of detail that a command writes into a folder instead of one scene."""

    count: int
    share: float
    suffix: str
    """Format of the files, without the point."""
    measure: bool

    def write(
        self,
        scene: Path,
        header: SceneHeader,
        table: SplatTable,
        folder: Path,
        files: FileOptions,
        force: bool,
    ) -> list[dict[str, Any]]:
        """Write the levels and lod.json, which lists them; return a record of each."""
        from gsedit.runs.json_lines import write_record
        from gsedit.toolkit.decimate import lod_tables, picture_change

        written = []
        for level, each in enumerate(lod_tables(table, self.count, self.share)):
            file = folder / f"{stem(scene)}_lod{level}.{self.suffix}"
            written.append(write_level(file, header, each, files, force))
            if self.measure and level:
                written[-1]["psnr"] = round(picture_change(table, each), 2)
            change = f", {written[-1]['psnr']} dB" if "psnr" in written[-1] else ""
            print_message(f"{file}: {len(each):,} Gaussians{change}")
        write_record({"levels": written}, folder / "lod.json", overwrite=force)
        return written


def stem(scene: Path) -> str:
    """Return the name of a scene without its suffix."""
    from gsedit.formats.table import INDEX, READABLE

    if scene.name == INDEX:
        return scene.absolute().parent.name
    fitting = [suffix for suffix in READABLE if scene.name.lower().endswith(suffix)]
    return scene.name[: -len(max(fitting, key=len, default="")) or None] or "scene"


def write_level(
    file: Path, header: SceneHeader, table: SplatTable, files: FileOptions, force: bool
) -> dict[str, Any]:
    """Write a level as its format can hold it; return its record."""
    from gsedit.formats.registry import writable_format, write_scene
    from gsedit.formats.streams import in_blocks
    from gsedit.toolkit.reduce_sh import ReduceSH

    reduce = ReduceSH(writable_format(file).max_degree)
    rows = in_blocks(reduce.apply(table))
    write_scene(file, reduce.header(header), rows, options=files.write(file), overwrite=force)
    return {"file": file.name, "gaussians": len(table)}
