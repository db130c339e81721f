"""`gsedit mesh`: triangles of the surfaces of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsedit.errors import UsageError

from ..core.command import option, output, shows
from ..core.console import print_message, print_result
from ..core.outputs import check_file
from ..options.cameras import ViewOptions, known_cameras
from ..options.common import Common, DropInvalid, Force, Scene, load_scene
from ..options.selection import SelectionOptions


@dataclass(frozen=True)
class MeshOptions:
    """Options of `gsedit mesh` alone."""

    out: Path = output(..., "Mesh to write: .glb, .ply, .obj or .stl.")
    faces: int = option(200_000, "Most triangles.", "N", min=4, max=20_000_000)
    watertight: bool = option(
        False, "Close the surface where no view saw it too, for printing and for volumes."
    )


@shows("--output", "--faces", "--watertight", "--where", "--region", "--data", "--force")
def mesh(
    scene: Scene,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    own: MeshOptions,
    selection: SelectionOptions,
    common: Common,
) -> None:
    """Make a mesh of what the views of a scene show.

    gsedit mesh scene.ply -o scene.glb

    gsedit mesh bear.ply --region auto --watertight --faces 50000 -o bear.stl

    Views are those of --data, those beside the scene, or found ones. Units are the scene's.
    """
    from gsedit.meshing.triangles import SUFFIXES

    if own.out.suffix.lower() not in SUFFIXES:
        raise UsageError(f"-o {own.out}: name a mesh file: {', '.join(SUFFIXES)}")
    check_file(own.out, force)
    chosen = selection.selection() if selection.given else None
    common.apply()

    import torch

    from gsedit.meshing import mesh as mesh_of
    from gsedit.meshing import save_mesh
    from gsedit.scene.table import table_of

    gaussians = load_scene(scene, drop_invalid=drop_invalid).detach()
    inside = None if chosen is None else torch.tensor(chosen.mask(table_of(gaussians)))
    known = known_cameras(scene, gaussians, ViewOptions(data=selection.data))
    if known is None:
        print_message("searching the scene for views; cameras beside it, or of --data, are better")
    cameras = [] if known is None else [each.camera for each in known.viewpoints]
    found = mesh_of(gaussians, cameras, inside=inside, faces=own.faces, watertight=own.watertight)
    save_mesh(found, own.out, overwrite=force)
    closed = found.is_closed
    record = {"mesh": own.out, "vertices": len(found.vertices), "faces": len(found.faces),
              "closed": closed, "volume": found.volume if closed else None}  # fmt: skip
    print_message(f"mesh: {len(found.faces):,} triangles, {'closed' if closed else 'open'}")
    for note in found.notes:
        print_message(f"mesh: {note}")
    print_result(record, str(own.out), as_json=common.json)
