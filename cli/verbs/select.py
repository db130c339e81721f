"""`gsedit select`: save which Gaussians are selected."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import option, output
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.common import Common, DropInvalid, Force, Scene
from ..options.files import FileOptions
from ..options.selection import SelectionOptions, need_selection

if TYPE_CHECKING:
    import numpy as np

    from gsedit.formats.streams import SceneSource
    from gsedit.toolkit.selection.base import Selection


@dataclass(frozen=True)
class SelectOptions:
    """Options of `gsedit select` alone."""

    out: Path | None = output(None, ".npy file of flags to write. Not needed by --dry-run.")
    dry_run: bool = option(False, "Only say how many are selected; write nothing.")


def select(
    scene: Scene,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    own: SelectOptions,
    selection: SelectionOptions,
    files: FileOptions,
    common: Common,
) -> None:
    """Save a selection, for --region of other commands.

    gsedit select scene.ply --where "sphere(0,-0.5,0, 0.35)" -o region.npy

    gsedit select bear.ply --where "subject('turn it into bronze')" --data photos/ -o bear.npy
    """
    if own.out is None and not own.dry_run:
        raise UsageError("name the file of flags to write with -o, or add --dry-run")
    check_file(own.out, force or own.dry_run, ".npy")
    chosen = need_selection(selection, "select")
    common.apply()

    from gsedit.formats.flags import write_flags
    from gsedit.formats.registry import open_scene

    source = open_scene(scene, files.read())
    flags = flags_of(source, chosen, drop_invalid=drop_invalid)
    count, total = int(flags.sum()), len(flags)
    print_message(f"select: {count:,} of {total:,} ({100 * count / max(total, 1):.1f} %)")
    written = None if own.dry_run else own.out
    if written is not None:
        write_flags(flags, written, overwrite=force)
    record = {"scene": scene, "output": written, "selected": count, "gaussians": total}
    text = str(written) if written else "nothing was written (--dry-run)"
    print_result(record, text, as_json=common.json)


def flags_of(source: SceneSource, selection: Selection, *, drop_invalid: bool) -> np.ndarray:
    """Return a flag for each row; reads in parts unless the selection needs the whole scene."""
    import numpy as np

    from gsedit.formats.streams import gather
    from gsedit.formats.validity import Guard
    from gsedit.toolkit.selection.part import masked, without_bands

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
