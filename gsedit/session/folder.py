"""The folder of an edit: the scene, what was measured, and pictures to look at."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsedit.files import atomic_path, save
from gsedit.files.atomic import check_writable
from gsedit.files.view_pictures import write_view_pictures
from gsedit.measures.against import HELD_OUT, TARGETS
from gsedit.regions.region import save_region
from gsedit.reports.environment import environment
from gsedit.reports.journal import as_record
from gsedit.reports.json_lines import write_line, write_record
from gsedit.session.held_out import SHOWN
from gsedit.session.result import EditResult

FILES = (
    "scene.ply", "region.npy", "metrics.jsonl", "before_after.png", "error_vs_time.png", "edit.json"
)  # fmt: skip


def write_edit(
    folder: Path | str,
    result: EditResult,
    *,
    request: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write scene.ply, region.npy, metrics.jsonl, before_after.png, error_vs_time.png, edit.json,
    and the 2D edits: targets/ (what the scene was fitted to), held_out/ (of held-out views).

    `request` is what else edit.json should say of how the result was made. Each file is whole or
    not there, and edit.json is last: with it the folder is complete. Raises UsageError where one of
    the files exists, unless `overwrite`, before it writes any.
    """
    folder = Path(folder)
    for name in FILES:
        check_writable(folder / name, overwrite=overwrite)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "edit.json").unlink(missing_ok=True)  # an earlier run's, about other files
    save(result.scene, folder / "scene.ply", overwrite=overwrite)
    save_region(result.region, folder / "region.npy", overwrite=overwrite)
    with (
        atomic_path(folder / "metrics.jsonl", overwrite=overwrite) as temporary,
        temporary.open("w", encoding="utf-8") as file,
    ):
        for event in result.events:
            write_line(file, as_record(event))
    _write_pictures(folder, result, overwrite=overwrite)
    write_view_pictures(folder / TARGETS, result.targets, overwrite=overwrite)
    write_view_pictures(folder / HELD_OUT, result.held_out.edited, overwrite=overwrite)
    record = {"instruction": result.prompt, **(request or {}), **edit_record(result)}
    write_record(record, folder / "edit.json", overwrite=overwrite)


def edit_record(result: EditResult) -> dict[str, Any]:
    """What edit.json says of a result: settings, timings, measurements, versions."""
    return {
        "settings": result.settings,
        "strategy": {"name": result.strategy_name, "settings": result.strategy},
        "work": {
            "update_steps": result.work.steps,
            "editor_calls": result.work.calls,
            "network_evaluations": result.work.evaluations,
        },
        "plan": result.decisions,
        "timings": result.timings,
        "gaussians": len(result.scene),
        "region": {
            "found": result.region.note,
            "gaussians": int(result.region.inside.sum()),
        },
        "edited_views": [view.name for view in result.targets],
        "measured": result.quality,
        **environment(),
    }


def _write_pictures(folder: Path, result: EditResult, *, overwrite: bool) -> None:
    """The same views before the edit, edited in 2D, and after it, with held-out ones beside them;
    error and loss against time."""
    from gsedit.files.pictures import save_picture
    from gsedit.reports.contact_sheet import contact_sheet
    from gsedit.reports.figures import error_vs_time

    held_out = result.held_out
    blank = len(held_out.originals) - len(held_out.edited)
    rows = [
        ("original", result.originals, held_out.originals),
        (f"2D targets: {result.prompt}", result.targets, (*held_out.edited, *(None,) * blank)),
        ("edited scene", result.finals, held_out.finals),
    ]
    sheet = contact_sheet(
        [(label, (*views, *more[:SHOWN])) for label, views, more in rows if views],
        apart=min(SHOWN, len(held_out.originals)),
        caption="held out",
    )
    save_picture(sheet, folder / "before_after.png", overwrite=overwrite)
    error_vs_time(result.events, folder / "error_vs_time.png", overwrite=overwrite)
