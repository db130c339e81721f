"""The folder of an edit: the scene, what was measured, and pictures to look at."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsedit.editing.measure import EditResult
from gsedit.errors import InputError
from gsedit.formats.edit_records import read_edit_record
from gsedit.formats.scenes import save
from gsedit.measures.against import ALONE, HELD_OUT, TARGETS, UNFINISHED
from gsedit.paper.evaluate import SHEET_HELD_OUT_VIEWS
from gsedit.run.atomic import atomic_path, check_writable
from gsedit.run.environment import environment
from gsedit.run.events import as_record
from gsedit.run.inputs import file_inside, safe_name
from gsedit.run.json_lines import write_line, write_record
from gsedit.select.region import save_region
from gsedit.views.view_pictures import write_view_pictures

FILES = (
    "scene.ply", "region.npy", "region_before.npy", "metrics.jsonl", "before_after.png",
    "edit.json",
)  # fmt: skip


def write_edit(
    folder: Path | str,
    result: EditResult,
    *,
    request: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write scene.ply, region.npy (flags of that scene's Gaussians), before_after.png, edit.json.

    Where objects went, also region_before.npy (flags of the unedited scene's Gaussians); where a 2D
    editor was asked, also metrics.jsonl, targets/ (what the scene was fitted to), held_out/ (the 2D
    edits of held-out views) and held_out_alone/ (those made without the targets).

    `request` is added to edit.json: how the result was made. Each file is whole or not there, and
    edit.json is last: with it the folder is complete. With `overwrite`, pictures that the edit.json
    of an earlier edit lists are removed. Raises UsageError where one of the files exists, unless
    `overwrite`, before it writes any; InputError for views whose names leave the folder.
    """
    folder = Path(folder)
    for name in FILES:
        check_writable(folder / name, overwrite=overwrite)
    folder.mkdir(parents=True, exist_ok=True)
    remove_earlier(folder)
    save(result.scene, folder / "scene.ply", overwrite=overwrite)
    save_region(result.region, folder / "region.npy", overwrite=overwrite)
    if result.region_before is not None:
        save_region(result.region_before, folder / "region_before.npy", overwrite=overwrite)
    else:
        (folder / "region_before.npy").unlink(missing_ok=True)
    if result.events:
        with (
            atomic_path(folder / "metrics.jsonl", overwrite=overwrite) as temporary,
            temporary.open("w", encoding="utf-8") as file,
        ):
            for event in result.events:
                write_line(file, as_record(event))
    _write_pictures(folder, result, overwrite=overwrite)
    pictures = {
        name: write_view_pictures(folder / name, views, overwrite=overwrite)
        for name, views in (
            (TARGETS, result.targets),
            (HELD_OUT, result.held_out.edited),
            (ALONE, result.held_out.alone),
        )
    }
    record = {"instruction": result.prompt, **(request or {}), **edit_record(result)}
    write_record({**record, "pictures": pictures}, folder / "edit.json", overwrite=overwrite)
    (folder / UNFINISHED).unlink(missing_ok=True)
    if not result.events:
        (folder / "metrics.jsonl").unlink(missing_ok=True)


def remove_earlier(folder: Path) -> None:
    """Remove the edit.json of an earlier edit, and the PNGs that it says the edit wrote."""
    file = folder / "edit.json"
    try:
        listed = json.loads(file.read_bytes())["pictures"]
        pictures = [
            file_inside(folder / name, safe_name(picture, str(file)), str(file))
            for name in (TARGETS, HELD_OUT, ALONE)
            for picture in listed.get(name, ())  # earlier versions wrote none alone
        ]
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError, InputError):
        pictures = []
    for picture in pictures:
        if picture.suffix == ".png" and picture.is_file():
            picture.unlink()
    file.unlink(missing_ok=True)


def edit_record(result: EditResult) -> dict[str, Any]:
    """The record of a result for edit.json: settings, timings, measurements, versions."""
    return {
        "settings": result.settings,
        "strategy": {"name": result.strategy_name, "settings": result.strategy},
        "work": {
            "update_steps": result.work.steps,
            "editor_calls": result.work.calls,
            "network_evaluations": result.work.evaluations,
        },
        "followed": {"gaussians": result.work.followed, "map_rmse": result.work.map_error},
        "view_plan": result.view_plan,
        "decisions": result.decisions,
        "timings": result.timings,
        "gaussians": len(result.scene),
        "region": {
            "found": result.region.note,
            "expression": result.region.how,
            "sure": round(result.region.sure, 3),
            "gaussians": int(result.region.inside.sum()),
        },
        **_objects(result),
        **_routes(result),
        "edited_views": [view.name for view in result.targets],
        "measured": result.metrics.record(),
        **environment(),
    }


def _objects(result: EditResult) -> dict[str, Any]:
    """Numbers of Gaussians before an edit of objects, that it changed or took, and that it made."""
    if result.region_before is None:
        return {}
    before, after = (r.inside for r in (result.region_before, result.region))
    return {
        "objects": {
            "gaussians_before": len(before),
            "changed_or_gone": int(before.sum()),
            "changed_or_new": int(after.sum()),
        }
    }


def _routes(result: EditResult) -> dict[str, Any]:
    """Changes that were read in the sentence, and the routes that did them."""
    if result.understood is None:
        return {}
    routes = dict.fromkeys(change.route for change in result.understood.changes)
    return {"route": "+".join(routes), "understood": result.understood, "notes": result.notes}


def _write_pictures(folder: Path, result: EditResult, *, overwrite: bool) -> None:
    """Write pictures of the views before the edit, edited in 2D and after it, with held-out ones
    beside them."""
    from gsedit.formats.pictures import save_picture
    from gsedit.pictures.contact_sheet import contact_sheet

    held_out = result.held_out
    blank = len(held_out.originals) - len(held_out.edited)
    done = "edited scene" if result.targets else f"edited: {result.prompt}"
    rows = [
        ("original", result.originals, held_out.originals),
        (f"2D targets: {result.prompt}", result.targets, (*held_out.edited, *(None,) * blank)),
        (done, result.finals, held_out.finals),
    ]
    few = SHEET_HELD_OUT_VIEWS if result.originals else len(held_out.originals)
    sheet = contact_sheet(
        [(label, (*views, *more[:few])) for label, views, more in rows if views or any(more)],
        apart=min(few, len(held_out.originals)) if result.originals else 0,
        caption="held out",
    )
    save_picture(sheet, folder / "before_after.png", overwrite=overwrite)


def history_of(scene: Path) -> dict[str, Any]:
    """`first_scene` (its path) and `history` (a record of each earlier edit, the first one first)
    of an edit of this scene file: from the edit.json beside it, if the scene came from an edit.

    Raises InputError for an edit.json that cannot be read.
    """
    path = scene.with_name("edit.json")
    if scene.name != "scene.ply" or not path.is_file():
        return {"first_scene": scene, "history": []}
    earlier = read_edit_record(path)
    return {
        "first_scene": earlier.get("first_scene") or earlier.get("scene"),
        "history": [*earlier.get("history", []), _summary(earlier)],
    }


def _summary(record: dict[str, Any]) -> dict[str, Any]:
    """A record that identifies an edit, with its measurements."""
    decided = {name: record.get(name) for name in ("settings", "strategy", "editor", "seed")}
    text = json.dumps(decided, sort_keys=True)
    editor, strategy = (record.get(name, {}) for name in ("editor", "strategy"))
    measured = record.get("measured", {}).items()
    return {
        "instruction": record.get("instruction"),
        "editor": editor.get("editor"),
        "strategy": strategy.get("name"),
        "settings_digest": hashlib.sha256(text.encode()).hexdigest()[:16],
        "measured": {name: value for name, value in measured if name != "pairs"},
    }
