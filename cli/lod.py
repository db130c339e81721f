"""`gsedit lod`: levels of detail."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message, print_result
from .decimate import amount_of
from .file_options import FileOptions
from .options import Common, DropInvalid, Force, Scene, check_folder, output

if TYPE_CHECKING:
    from gsedit.files.streams import SceneHeader
    from gsedit.files.table import SplatTable

Levels = Annotated[int, typer.Option("--levels", min=2, max=16, help="Files to write.")]
Share = Annotated[
    str, typer.Option("--share", metavar="N%", help="Of each level's Gaussians that the next has.")
]
Format = Annotated[
    str, typer.Option("--format", metavar="SUFFIX", help="Of the files, as ply or spz.")
]
Measure = Annotated[
    bool, typer.Option("--measure/--no-measure", help="Tell how much pictures change, in dB.")
]


def lod(
    scene: Scene,
    out: Annotated[Path | None, output("Folder to write.")] = None,
    levels: Levels = 4,
    share: Share = "50%",
    format: Format = "ply",
    measure: Measure = True,
    force: Force = False,
    drop_invalid: DropInvalid = False,
    *,
    files: FileOptions,
    common: Common,
) -> None:
    """Write a scene at several levels of detail, each with half the Gaussians of the one before.

    gsedit lod scene.ply --levels 4 -o folder

    The folder gets scene_lod0.ply (the scene itself), scene_lod1.ply, ... and lod.json, which lists
    them with their numbers of Gaussians and PSNR against level 0, from an orbit.
    """
    from gsedit.errors import UsageError
    from gsedit.files.formats import writable_format

    if out is None:
        raise UsageError("name the folder to write with -o")
    amount = amount_of(share).get("share")
    if amount is None:
        raise UsageError(f"--share {share}: give a share, as 50%")
    name, suffix = _stem(scene), format.lstrip(".")
    writable_format(f"{name}.{suffix}")
    check_folder(out, force)
    common.apply()
    header, table = _read(scene, files, drop_invalid)
    written = []
    from gsedit.points.lod import lod_tables
    from gsedit.reports.json_lines import write_record

    for level, each in enumerate(lod_tables(table, levels, amount)):
        file = out / f"{name}_lod{level}.{suffix}"
        written.append(_write(file, header, each, table, files, measure and level > 0, force))
    write_record({"levels": written}, out / "lod.json", overwrite=force)
    print_result({"output": out, "levels": written}, str(out), as_json=common.json)


def _stem(scene: Path) -> str:
    """The name of a scene without its suffix."""
    from gsedit.files.formats import READABLE

    if scene.name == "meta.json":  # in the folder of a SOG scene
        return scene.absolute().parent.name
    fitting = [suffix for suffix in READABLE if scene.name.lower().endswith(suffix)]
    return scene.name[: -len(max(fitting, key=len, default="")) or None] or "scene"


def _read(scene: Path, files: FileOptions, drop: bool) -> tuple[SceneHeader, SplatTable]:
    from gsedit.errors import InputError
    from gsedit.files.formats import open_scene
    from gsedit.files.streams import gather
    from gsedit.files.validity import Guard

    source = open_scene(scene, files.read())
    for note in source.notes:
        print_message(f"{scene}: {note}")
    guard = Guard(drop=drop)
    table = gather(guard(source.blocks()), source.header, source.count)
    guard.check(scene, InputError)
    return source.header, table


def _write(
    file: Path,
    header: SceneHeader,
    table: SplatTable,
    first: SplatTable,
    files: FileOptions,
    measure: bool,
    force: bool,
) -> dict[str, Any]:
    """Write a level; what is said of it."""
    from gsedit.files.formats import lost, writable_format, write_scene
    from gsedit.files.streams import in_blocks
    from gsedit.points.reduce_sh import ReduceSH

    format = writable_format(file)
    if table is first:
        for sentence in lost(header, format):
            print_message(f"{file}: {sentence}")
    reduce = ReduceSH(format.max_degree)
    rows = in_blocks(reduce.apply(table))
    write_scene(file, reduce.header(header), rows, options=files.write(file), overwrite=force)
    record: dict[str, Any] = {"file": file.name, "gaussians": len(table)}
    text = f"{file}: {len(table):,} Gaussians"
    if measure:
        from gsedit.points.picture_change import picture_change

        record["psnr"] = round(picture_change(first, table), 2)
        text += f", {record['psnr']} dB"
    print_message(text)
    return record
