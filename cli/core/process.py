"""Read a scene, change it and write it again, a block at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

from ..options.common import DropInvalid, Force
from .checkpoints import open_checkpoint
from .command import option, output
from .console import print_message
from .outputs import check_file, check_folder

if TYPE_CHECKING:
    from gsedit.formats.streams import Blocks, SceneHeader, SceneSource
    from gsedit.formats.validity import Guard
    from gsedit.scene.table import SplatTable
    from gsedit.toolkit.operation import Operation, RowCounts

    from ..options.files import FileOptions

CHECKPOINT = ".safetensors"
"""Suffix of the checkpoint of an edit or a fit."""


@dataclass(frozen=True)
class Output:
    """Options that say where the scene goes."""

    out: Path | None = output(None, "Scene to write; its suffix is the format.")
    force: Force = False
    dry_run: bool = option(False, "Only count what would be kept; write nothing.")
    drop_invalid: DropInvalid = False


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


def process(
    path: Path,
    steps: list[tuple[str, Operation]],
    output: Output,
    files: FileOptions,
    levels: Levels | None,
) -> tuple[list[tuple[str, RowCounts]], Path | None]:
    """Read, change and write a scene in blocks; return the counts of each step, then the total."""
    from gsedit.formats.validity import Guard
    from gsedit.toolkit.operation import RowCounts, run

    check_output(output, levels)
    source = open_source(path, files)
    write_companions = companions(path, output, [each for _, each in steps])
    for note in source.notes:
        print_message(f"{path}: {note}")
    first, last = Guard(drop=output.drop_invalid), Guard(drop=False, of="the result")
    total, operations = RowCounts(before=source.count), [each for _, each in steps]
    header, blocks, counts = run(
        source.header, first(source.blocks()), operations, partial(_say, path)
    )
    if levels is None:
        header, blocks = fitted(header, blocks, output.out)
    blocks = _checked(last(blocks), first, last, source.path, total)
    write(path, header, blocks, output, files, levels)
    write_companions()
    if output.drop_invalid and first.invalid:
        print_message(f"{path}: rows left out by --drop-invalid: {first.invalid:,}")
    named = [(verb, kept) for (verb, _), (_, kept) in zip(steps, counts)]
    for verb, kept in ((v, k) for (v, o), (_, k) in zip(steps, counts) if o.removes):
        print_message(f"{verb}: {kept}")
    return [*named, ("all", total)], None if output.dry_run else output.out


def check_output(output: Output, levels: Levels | None) -> None:
    """Raise UsageError unless the scene, or the folder of its levels, can be written."""
    from gsedit.formats.registry import writable_format

    if output.out is None:
        if not output.dry_run:
            what = "scene" if levels is None else "folder"
            raise UsageError(f"name the {what} to write with -o, or add --dry-run")
    elif levels is not None:
        check_folder(output.out, output.force or output.dry_run)
    else:
        writable_format(output.out)
        check_file(output.out, output.force or output.dry_run)


def open_source(path: Path, files: FileOptions) -> SceneSource:
    """Open a scene file, or the checkpoint of an interrupted edit or fit."""
    if path.suffix == CHECKPOINT:
        return open_checkpoint(path)
    from gsedit.formats.registry import open_scene

    return open_scene(path, files.read())


def write(
    path: Path,
    header: SceneHeader,
    blocks: Blocks,
    output: Output,
    files: FileOptions,
    levels: Levels | None,
) -> None:
    """Write the scene or its levels of detail; a dry run only reads the blocks."""
    from gsedit.formats.registry import write_scene
    from gsedit.formats.streams import gather

    if output.dry_run or output.out is None:
        for _ in blocks:
            pass
    elif levels is None:
        write_scene(
            output.out, header, blocks, options=files.write(output.out), overwrite=output.force
        )
    else:
        levels.write(path, header, gather(blocks, header, 0), output.out, files, output.force)


def companions(path: Path, output: Output, operations: list[Operation]) -> Callable[[], None]:
    """Return a function that writes the moved cameras (--cameras) and similarities (--save).

    Raises UsageError now if one of these files cannot be written.
    """
    saving = [each for each in operations if getattr(each, "save", None)]
    for each in saving:
        check_file(each.save, output.force or output.dry_run, ".json")  # pyright: ignore[reportAttributeAccessIssue]
    cameras = None
    if any(getattr(each, "cameras", False) for each in operations):
        from gsedit.toolkit.moved_cameras import CameraMove

        cameras = CameraMove(path, None if output.dry_run else output.out, output.force)

    def write() -> None:
        if output.dry_run:
            return
        for each in saving:
            from gsedit.toolkit.similarity_files import write_similarity

            write_similarity(each.moved, each.save, overwrite=output.force)  # pyright: ignore[reportAttributeAccessIssue]
            print_message(f"the similarity: {each.save}")  # pyright: ignore[reportAttributeAccessIssue]
        if cameras and (file := cameras.write(operations)):
            print_message(f"cameras moved along: {file}")

    return write


def fitted(header: SceneHeader, blocks: Blocks, out: Path | None) -> tuple[SceneHeader, Blocks]:
    """Reduce the scene to what its format holds, and print what is lost."""
    if out is None:
        return header, blocks
    from gsedit.formats.registry import lost, writable_format
    from gsedit.toolkit.operation import run
    from gsedit.toolkit.reduce_sh import ReduceSH

    format = writable_format(out)
    for sentence in lost(header, format):
        print_message(f"{out}: {sentence}")
    if header.degree <= format.max_degree:
        return header, blocks
    return run(header, blocks, [ReduceSH(format.max_degree)], partial(_say, out))[:2]


def _checked(blocks: Any, first: Guard, last: Guard, path: Path, total: RowCounts) -> Any:
    """Yield the blocks and count them; raise for invalid rows before the file gets its name.

    `first` has seen the file and `last` the result: rows may have become invalid on the way.
    """
    for block in blocks:
        total.after += len(block)
        yield block
    if first.drop or last.invalid:  # a row of the file is named by its place there
        first.check(path)
    if last.invalid:
        raise UsageError(
            f"{path}: {last.invalid:,} of {last.rows:,} rows became invalid on the way, "
            f"the first is {last.first}: give the operations smaller numbers"
        )


def _say(path: Path, text: str) -> None:
    print_message(f"{path}: {text}")
