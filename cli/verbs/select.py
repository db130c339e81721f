"""`gsedit select`: save which Gaussians are selected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option, shows
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.common import FileOptions, Reads, Scene, Writes, load_scene
from ..options.selection import (
    MaskOptions,
    PointingOptions,
    SelectionOptions,
    finder_in,
    need_selection,
)

if TYPE_CHECKING:
    import numpy as np

    from gsedit.formats.streams import SceneSource
    from gsedit.select.finder import Finder
    from gsedit.select.masked import MaskProvider
    from gsedit.select.region import Region
    from gsedit.select.selection import Selection
    from gsedit.views.viewpoints import Viewpoint
    from rasterizer.scene import Gaussians

UNWRITTEN = "nothing was written (--dry-run)"


@dataclass(frozen=True)
class SelectOptions(Reads, Writes):
    """Options of `gsedit select` alone."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """.npy file of flags to write, or a .png that shows what --at, --phrase or --objects find."""
    name: str | None = option(None, "NAME", flags="--as")
    """Save what --at or --phrase selects beside the scene: --region NAME of other commands then
    means it."""
    objects: bool = option(False)
    """List the objects of the scene, and draw them into -o FILE.png."""
    dry_run: bool = option(False)
    """Only say how many are selected; write nothing."""


@shows(
    "--at", "--phrase", "--objects", "--as", "--where", "--region", "--data", "--size", "--output",
    "--dry-run", "--force",
)  # fmt: skip
def select(
    scene: Scene,
    *,
    own: SelectOptions,
    pointing: PointingOptions,
    masks: MaskOptions,
    selection: SelectionOptions,
    files: FileOptions,
) -> None:
    """Save a selection, for --region of other commands.

    gsedit select scene.ply --where "sphere(0,-0.5,0, 0.35)" -o region.npy

    gsedit select bear.ply --where "subject()" --data posed/ -o bear.npy

    gsedit select bear.ply --at frame_00001.jpg:120,120 --as bear

    gsedit select bear.ply --objects -o objects.png
    """
    if own.objects or pointing.given:
        provider = masks.make(pointing.phrase)
        return select_thing(scene, own, pointing, provider, selection)
    masks.make(None)
    if own.name is not None:
        raise UsageError("--as saves what --at or --phrase selects: add one of them")
    if own.out is None and not own.dry_run:
        raise UsageError("name the file of flags to write with -o, or add --dry-run")
    check_file(own.out, own.force or own.dry_run, ".npy")
    chosen = need_selection(selection, "select")

    from gsedit.formats.files import open_scene
    from gsedit.formats.flags import write_flags

    source = open_scene(scene, files.read())
    flags = flags_of(source, chosen, drop_invalid=own.drop_invalid)
    count, total = int(flags.sum()), len(flags)
    print_message(f"select: {count:,} of {total:,} ({100 * count / max(total, 1):.1f} %)")
    written = None if own.dry_run else own.out
    if written is not None:
        write_flags(flags, written, overwrite=own.force)
    record = {"scene": scene, "output": written, "selected": count, "gaussians": total}
    print_result(record, str(written or UNWRITTEN))


def select_thing(
    scene: Path,
    own: SelectOptions,
    pointing: PointingOptions,
    masks: MaskProvider | None,
    selection: SelectionOptions,
) -> None:
    """Select what is pointed at, or list the objects. Raises UsageError."""
    check_thing(scene, own, pointing, selection)
    gaussians = load_scene(scene, drop_invalid=own.drop_invalid).detach()
    finder = finder_in(selection.data, pointing.size, masks)(gaussians)
    views = finder.viewpoints
    if own.objects:
        return list_objects(scene, finder, own)
    found = pointing.region(finder)
    print_message(f"select: {found}")
    written = [] if own.dry_run else save_thing(found, scene, gaussians, views, own)
    count, total = int(found.inside.sum()), len(found.inside)
    record = {"scene": scene, "output": written, "selected": count, "gaussians": total}
    print_result({**record, "note": found.note}, "\n".join(map(str, written)) or UNWRITTEN)


def check_thing(
    scene: Path, own: SelectOptions, pointing: PointingOptions, selection: SelectionOptions
) -> None:
    """Raise UsageError for options that do not go together, or a place that cannot be written."""
    from gsedit.select.saved import check_name, saved_file

    pointing.check()
    if selection.given or (own.objects and (pointing.given or own.name is not None)):
        raise UsageError("--objects, --at and --phrase go alone: leave out --where and --region")
    if own.name is not None:
        name = check_name(own.name)
        if not own.force and not own.dry_run and saved_file(scene, name):
            raise UsageError(f"the selection {name} of {scene} exists: add --force to replace it")
    elif own.out is None and not own.dry_run and not own.objects:
        raise UsageError("name the selection with --as NAME, or the file with -o, or add --dry-run")
    pictured = own.objects or (own.out is not None and own.out.suffix.lower() == ".png")
    check_file(own.out, own.force or own.dry_run, ".png" if pictured else ".npy")


def save_thing(
    found: Region, scene: Path, gaussians: Gaussians, views: Sequence[Viewpoint], own: SelectOptions
) -> list[Path]:
    """Write a selection where it was asked for; return the files."""
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.segment_sheet import region_sheet
    from gsedit.select.region import save_region
    from gsedit.select.saved import save_named

    written = []
    if own.out is not None and own.out.suffix.lower() == ".png":
        save_picture(region_sheet(gaussians, found, views), own.out, overwrite=own.force)
        written.append(own.out)
    elif own.out is not None:
        save_region(found, own.out, overwrite=own.force)
        written.append(own.out)
    if own.name is not None:
        flags, means = found.inside.numpy(), gaussians.means.numpy()
        written.append(save_named(flags, means, scene, own.name, overwrite=own.force))
    return written


def list_objects(scene: Path, finder: Finder, own: SelectOptions) -> None:
    """Print the segments of a scene, a line each, and draw them."""
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.segment_sheet import segment_sheet
    from gsedit.select.phrase import names

    segments, out = finder.segments, own.out
    told = names(segments)
    if out is not None:
        sheet = segment_sheet(finder.scene, segments, told, finder.viewpoints)
        save_picture(sheet, out, overwrite=own.force)
    lines, records = [], []
    for row, name in zip(segments.rows, told):
        count = int((segments.labels == row.number).sum())
        on = f", on {told[row.stands_on]}" if row.stands_on >= 0 else ""
        lines.append(f"{row.number:3} {name}: {count:,} Gaussians, {row.pixels:.1%} of views{on}")
        records.append({"number": row.number, "name": name, "kind": row.kind, "gaussians": count})
    text = "\n".join([*lines, *([str(out)] if out else [])])
    print_result({"scene": scene, "output": out, "segments": records}, text)


def flags_of(source: SceneSource, selection: Selection, *, drop_invalid: bool) -> np.ndarray:
    """Return a flag for each row; reads in parts unless the selection needs the whole scene."""
    import numpy as np

    from gsedit.formats.streams import gather
    from gsedit.formats.validity import Guard

    for note in source.notes:
        print_message(f"{source.path}: {note}")
    guard = Guard(drop=drop_invalid)
    blocks = guard(source.blocks())
    header = source.header
    if not selection.view_dependent:  # most of the memory is SH above the first band
        header = header.replace(degree=0)
        blocks = (table.replace(sh=table.sh[:, :1]) for table in blocks)
    if selection.whole:
        blocks = iter([gather(blocks, header, source.count)])
    masks = [selection.mask(table) for table in blocks]
    guard.check(source.path)
    return np.concatenate(masks) if masks else np.zeros(0, bool)
