"""The folder of an edit by routes: the scene, pictures before and after, and the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsedit.datasets.dataset import View, capture
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.editing.routes.apply import Routed
from gsedit.editing.session.folder import FILES, remove_earlier
from gsedit.formats.pictures import save_picture
from gsedit.formats.scenes import save
from gsedit.measures.against import HELD_OUT, TARGETS
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import INSIDE, NEAREST, pooled_rmse, rmse, squared_error
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.regions.region import coverage, save_region
from gsedit.runs.environment import environment
from gsedit.runs.json_lines import write_record
from gsedit.words.instruction import Instruction
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians


@dataclass(frozen=True, eq=False)
class Compared:
    """Held-out views of a scene before and after routes changed it."""

    before: tuple[View, ...]
    after: tuple[View, ...]
    changed: float
    """RMSE between both, display values."""
    psnr_outside: float | None
    """PSNR over the pixels outside the region, dB; None where nothing is outside."""


def compare(
    scene: Gaussians, routed: Routed, viewpoints: Sequence[Viewpoint], execution: Execution = AUTO
) -> Compared:
    """Render a scene before and after its edit, and measure the difference."""
    cameras, names = [each.camera for each in viewpoints], [each.name for each in viewpoints]
    before = capture(scene, cameras, names, execution)
    after = capture(routed.scene, cameras, names, execution)
    changed = sum(rmse(new.image, old.image) for new, old in zip(after, before)) / len(before)
    if routed.region.is_all:
        return Compared(before, after, changed, None)
    error = pooled_rmse(
        squared_error(
            old.image,
            new.image,
            coverage(routed.region, scene, old.camera, execution) < INSIDE,
        )
        for old, new in zip(before, after)
    )
    outside = None if error is None else min(psnr_from_rmse(error), NEAREST)
    return Compared(before, after, changed, outside)


def write_routed(
    folder: Path,
    instruction: Instruction,
    routed: Routed,
    compared: Compared,
    *,
    timings: Mapping[str, float],
    request: Mapping[str, Any],
) -> None:
    """Write scene.ply, region.npy, before_after.png, and last edit.json; earlier files of an edit
    are replaced."""
    folder.mkdir(parents=True, exist_ok=True)
    remove_earlier(folder)
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    save(routed.scene, folder / "scene.ply", overwrite=True)
    save_region(routed.region, folder / "region.npy", overwrite=True)
    rows = [("original", compared.before), (f"edited: {instruction.text}", compared.after)]
    save_picture(contact_sheet(rows), folder / "before_after.png", overwrite=True)
    record = routed_record(instruction, routed, compared)
    write_record(
        {"instruction": instruction.text, **request, **record, "timings": timings},
        folder / "edit.json",
        overwrite=True,
    )


def routed_record(instruction: Instruction, routed: Routed, compared: Compared) -> dict[str, Any]:
    """The record of an edit by routes for edit.json: what was read, done and measured."""
    return {
        "route": "+".join(dict.fromkeys(change.route for change in instruction.changes)),
        "understood": instruction,
        "strategy": {"name": "routes"},
        "gaussians": len(routed.scene),
        "region": {"found": routed.region.note, "gaussians": int(routed.region.inside.sum())},
        "notes": list(routed.notes),
        "edited_views": [],
        "pictures": {TARGETS: [], HELD_OUT: []},
        "measured": {
            "rmse_to_unedited": compared.changed,
            "psnr_outside_region": compared.psnr_outside,
        },
        **environment(),
    }
