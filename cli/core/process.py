"""Read a scene, change it and write it again, a block at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import UsageError

from ..options.common import FileOptions, Reads, Writes
from .checkpoints import open_checkpoint
from .command import option
from .console import print_message
from .outputs import check_file

if TYPE_CHECKING:
    from gsedit.formats.streams import Blocks, SceneHeader, SceneSource
    from gsedit.formats.validity import Guard
    from gsedit.toolkit.operation import Operation, RowCounts

CHECKPOINT = ".safetensors"
"""Suffix of the checkpoint of an edit or a fit."""


@dataclass(frozen=True)
class Output(Reads, Writes):
    """Options that say where the scene goes."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """Scene to write; its suffix is the format."""
    dry_run: bool = option(False)
    """Only count what would be kept; write nothing."""


def process(
    path: Path, steps: list[tuple[str, Operation]], output: Output, files: FileOptions
) -> tuple[list[tuple[str, RowCounts]], Path | None]:
    """Read, change and write a scene in blocks; return the counts of each step, then the total."""
    from gsedit.formats.files import write_scene
    from gsedit.formats.validity import Guard
    from gsedit.toolkit.operation import RowCounts, run

    check_output(output)
    source = open_source(path, files)
    write_companions = companions(path, output, [each for _, each in steps])
    for note in source.notes:
        print_message(f"{path}: {note}")
    first, last = Guard(drop=output.drop_invalid), Guard(drop=False, of="the result")
    total, operations = RowCounts(before=source.count), [each for _, each in steps]
    header, blocks, counts = run(
        source.header, first(source.blocks()), operations, partial(_say, path)
    )
    header, blocks = fitted(header, blocks, output.out)
    blocks = _checked(last(blocks), first, last, source.path, total)
    if output.dry_run or output.out is None:
        for _ in blocks:
            pass
    else:
        write_scene(output.out, header, blocks, overwrite=output.force)
    write_companions()
    if output.drop_invalid and first.invalid:
        print_message(f"{path}: rows left out by --drop-invalid: {first.invalid:,}")
    named = [(verb, kept) for (verb, _), (_, kept) in zip(steps, counts)]
    for verb, kept in ((v, k) for (v, o), (_, k) in zip(steps, counts) if o.removes):
        print_message(f"{verb}: {kept}")
    return [*named, ("all", total)], None if output.dry_run else output.out


def check_output(output: Output) -> None:
    """Raise UsageError unless the scene can be written."""
    from gsedit.formats.files import writable_format

    if output.out is not None:
        writable_format(output.out)
        check_file(output.out, output.force or output.dry_run)
    elif not output.dry_run:
        raise UsageError("name the scene to write with -o, or add --dry-run")


def open_source(path: Path, files: FileOptions) -> SceneSource:
    """Open a scene file, or the checkpoint of an interrupted edit or fit."""
    if path.suffix == CHECKPOINT:
        return open_checkpoint(path)
    from gsedit.formats.files import open_scene

    return open_scene(path, files.read())


def companions(path: Path, output: Output, operations: list[Any]) -> Callable[[], None]:
    """Return a function that writes the moved cameras (--cameras) and similarities (--save).

    Raises UsageError now if one of these files cannot be written, or there are no cameras.
    """
    saving = [each for each in operations if getattr(each, "save", None)]
    for each in saving:
        check_file(each.save, output.force or output.dry_run, ".json")
    viewpoints, target = (), None
    if any(getattr(each, "cameras", False) for each in operations):
        from gsedit.views.cameras_json import cameras_file, own_file, read_cameras

        file = cameras_file(path)
        if file is None:
            raise UsageError(f"{path} has no cameras.json beside it: leave out --cameras")
        viewpoints = read_cameras(file)
        target = None if output.out is None else own_file(output.out)
        check_file(target, output.force or output.dry_run)

    def write() -> None:
        for each in saving:
            from gsedit.toolkit.transform import write_similarity

            write_similarity(each.moved, each.save, overwrite=output.force)
            print_message(f"the similarity: {each.save}")
        if target is not None:
            from gsedit.scene.similarity import IDENTITY, moved_camera
            from gsedit.views.cameras_json import write_cameras

            whole = IDENTITY
            for each in operations:
                whole = each.moved.after(whole) if each.moves else whole
            moved = [replace(v, camera=moved_camera(v.camera, whole)) for v in viewpoints]
            write_cameras(moved, target, overwrite=output.force)
            print_message(f"cameras moved along: {target}")

    return (lambda: None) if output.dry_run else write


def fitted(header: SceneHeader, blocks: Blocks, out: Path | None) -> tuple[SceneHeader, Blocks]:
    """Reduce the scene to what its format holds, and print what is lost."""
    if out is None:
        return header, blocks
    from gsedit.formats.files import lost, writable_format
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
