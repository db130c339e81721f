"""`gsedit select`: save which Gaussians are selected."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import print_message, print_result
from .file_options import FileOptions
from .options import Common, DropInvalid, Force, Scene, check_file, output
from .selection_options import SelectionOptions, need_selection

if TYPE_CHECKING:
    import numpy as np

    from gsedit.files.streams import SceneSource
    from gsedit.points.selection.base import Selection


def select(
    scene: Scene,
    out: Annotated[
        Path | None, output(".npy file of flags to write. Not needed by --dry-run.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say how many are selected; write nothing.")
    ] = False,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    selection: SelectionOptions,
    files: FileOptions,
    common: Common,
) -> None:
    """Save which Gaussians all options select: a region for edit --region, and for filter
    --region.

    gsedit select scene.ply --sphere 0,-0.5,0,0.35 -o region.npy
    """
    from gsedit.errors import UsageError

    if out is None and not dry_run:
        raise UsageError("name the file of flags to write with -o, or add --dry-run")
    if out is not None:
        if out.suffix.lower() != ".npy":
            raise UsageError(f"-o {out}: name a .npy file")
        check_file(out, force or dry_run)
    chosen = need_selection(selection, "select")
    common.apply()

    from gsedit.files.flags import write_flags
    from gsedit.files.formats import open_scene

    source = open_scene(scene, files.read())
    flags = flags_of(source, chosen, drop_invalid=drop_invalid)
    count, total = int(flags.sum()), len(flags)
    print_message(f"select: {count:,} of {total:,} ({100 * count / max(total, 1):.1f} %)")
    written = None if dry_run else out
    if written is not None:
        write_flags(flags, written, overwrite=force)
    record = {"scene": scene, "output": written, "selected": count, "gaussians": total}
    text = str(written) if written else "nothing was written (--dry-run)"
    print_result(record, text, as_json=common.json)


def flags_of(source: SceneSource, selection: Selection, *, drop_invalid: bool) -> np.ndarray:
    """Which rows of a file are selected, read in parts unless the selection needs it whole."""
    import numpy as np

    from gsedit.files.streams import gather
    from gsedit.files.validity import Guard
    from gsedit.points.selection.part import masked, without_bands

    for note in source.notes:
        print_message(f"{source.path}: {note}")
    guard = Guard(drop=drop_invalid)
    blocks = guard(source.blocks())
    if selection.whole and not selection.view_dependent:
        header = source.header.replace(degree=0)
        blocks = iter([gather(map(without_bands, blocks), header, source.count)])
    masks = [inside for _, inside in masked(blocks, selection)]
    guard.check(source.path)
    return np.concatenate(masks) if masks else np.zeros(0, bool)
