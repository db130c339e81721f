"""Levels of detail of a scene, a file each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import print_message

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gsedit.formats.streams import SceneHeader
    from gsedit.scene.table import SplatTable

    from ..options.common import FileOptions


STREAMED = "streamed"
"""Word for streamed SOG, which is a folder and not a suffix."""


@dataclass(frozen=True)
class Levels:
    """Levels of detail that a command writes into a folder instead of one scene."""

    count: int
    share: float
    suffix: str
    """Format of the files, without the point; or STREAMED."""
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
        from gsedit.toolkit.decimate import lod_tables

        if self.suffix == STREAMED:
            return self.stream(header, table, folder, force)
        written = []
        for level, each in enumerate(lod_tables(table, self.count, self.share)):
            file = folder / f"{stem(scene)}_lod{level}.{self.suffix}"
            record = write_level(file, header, each, files, force)
            written.append(self.told(record, str(file), level, table, each))
        write_record({"levels": written}, folder / "lod.json", overwrite=force)
        return written

    def stream(
        self, header: SceneHeader, table: SplatTable, folder: Path, force: bool
    ) -> list[dict[str, Any]]:
        """Write the levels as one streamed SOG; return a record of each."""
        from gsedit.toolkit.decimate import lod_tables
        from gsedit.toolkit.reduce_sh import ReduceSH
        from gsedit.toolkit.streamed import write_streamed

        written = []

        def levels() -> Iterator[SplatTable]:
            for level, each in enumerate(lod_tables(table, self.count, self.share)):
                yield ReduceSH(3).apply(each)
                record = {"level": level, "gaussians": len(each)}
                written.append(self.told(record, f"{folder}: level {level}", level, table, each))

        write_streamed(folder, levels(), antialiased=header.antialiased, overwrite=force)
        return written

    def told(
        self, record: dict[str, Any], name: str, level: int, table: SplatTable, each: SplatTable
    ) -> dict[str, Any]:
        """Return the record with how much pictures change, and print it."""
        if self.measure and level > 0:
            from gsedit.toolkit.picture_change import picture_change

            record["psnr"] = round(picture_change(table, each), 2)
        change = f", {record['psnr']} dB" if "psnr" in record else ""
        print_message(f"{name}: {len(each):,} Gaussians{change}")
        return record


def stem(scene: Path) -> str:
    """Return the name of a scene without its suffix."""
    from gsedit.formats.table import INDICES, READABLE

    if scene.name in INDICES:
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
