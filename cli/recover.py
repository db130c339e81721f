"""`gsedit recover`: a scene of the checkpoint that interrupted work left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .checkpoints import NAME
from .console import print_message, print_result
from .file_options import FileOptions
from .options import Common, Force, check_scene_file, load_scene, output

Left = Annotated[
    Path,
    typer.Argument(
        metavar="CHECKPOINT",
        show_default=False,
        help="What an interrupted edit or fit left: the folder of the edit, or the file "
        ".safetensors.",
    ),
]


def recover(
    checkpoint: Left,
    out: Annotated[Path, output("Scene to write: .ply, .compressed.ply or .spz.")],
    force: Force = False,
    *,
    common: Common,
) -> None:
    """Make a scene of the last checkpoint of an interrupted edit or fit.

    gsedit recover out/ -o so_far.ply
    """
    check_scene_file(out, force)
    common.apply()
    from gsedit.files import save
    from gsedit.files.state import load_state
    from gsedit.fitting.optimiser import optimised_scene

    state = load_state(checkpoint / NAME if checkpoint.is_dir() else checkpoint)
    source = state.record.get("source", {})
    unedited = None
    if "scene" in source:
        path = Path(source["scene"])
        unedited = load_scene(path, drop_invalid=source["drop_invalid"])
    scene = optimised_scene(state.within("optimiser"), unedited)
    save(scene, out, overwrite=force, options=FileOptions().write(out))
    print_message(f"{len(scene)} Gaussians; look: gsedit preview {out}")
    print_result({"scene": out, "gaussians": len(scene)}, str(out), as_json=common.json)
