"""Numbers of edits beside numbers of the same edits by meters that the method does not know.

python -m research.measure_meters bear.ply ../shared/data/bear -o out/meters

The bear to bronze, as a material and by `small`: OUT has both edits, the masks drawn by hand, and
a record of `gsedit metrics` of each. Edits that are there already are not made again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from scipy.ndimage import distance_transform_edt

from gsedit.datasets.view_list_files import read_view_list
from gsedit.formats.pictures import as_picture, save_picture
from gsedit.formats.scenes import load
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import INSIDE, pooled_rmse, squared_error
from gsedit.regions.masks import read_masks
from gsedit.scene.picture import render_picture
from research.command import Output, print_result, run
from research.measure_regions import DRAWN_SIZE, drawn, outlines_of

SENTENCE = "turn the bear into a bronze statue"
EDITORS = {"material": ("--editor", "auto"), "small": ("--editor", "small", "--batches", "2")}
ROWS = (
    ("outside, dB", "psnr_outside_region", "held_out"),
    ("outside, dB", "psnr_outside_masks", "all"),
    ("held-out edits, dB", "psnr_to_targets", "held_out"),
    ("held-out edits, dB", "psnr_to_edits_alone", "held_out"),
    ("agreement of targets, excess", "warp_targets_short", None),
    ("agreement of targets, excess", "warp_targets_long", None),
    ("agreement of targets, excess", "points_targets", None),
    ("agreement of renders, excess", "warp_renders_short", None),
    ("agreement of renders, excess", "warp_renders_long", None),
    ("agreement of renders, excess", "points_renders", None),
)
"""(what is asked, name of the metric, role of the views) of each row of the table."""
MARGINS = (2.0, 4.0)
"""Distances from the drawn outlines, pixels: those on the outline are mixed."""


def write_masks(folder: Path) -> None:
    """The outlines of the bear as white pictures named after their photos."""
    folder.mkdir(parents=True, exist_ok=True)
    for view in outlines_of("bear"):
        mask = drawn(view["outlines"], DRAWN_SIZE)
        file = folder / f"{Path(view['photo']).stem}.png"
        save_picture(as_picture(mask[..., None].expand(-1, -1, 3)), file, overwrite=True)


def gsedit(*words: object) -> None:
    """Run a command. Raises CalledProcessError where it fails."""
    subprocess.run([sys.executable, "-m", "gsedit_cli", *map(str, words)], check=True)


def measure(bear: Path, photos: Path, out: Path, name: str) -> dict[str, Any]:
    """The record of an edit, which is made if it is not there."""
    folder, record = out / name, out / f"{name}.json"
    if not (folder / "edit.json").exists():
        gsedit("edit", bear, SENTENCE, "--data", photos, *EDITORS[name], "-o", folder)
    gsedit("metrics", folder, "--subject-masks", out / "masks", "-o", record, "--force")
    return json.loads(record.read_text())


@torch.no_grad()
def kept(bear: Path, out: Path, name: str, margin: float) -> float:
    """PSNR to the unedited scene, dB, farther than so many pixels outside the drawn outlines."""
    views = read_view_list(out / name / "views.json").viewpoints
    before, after = load(bear), load(out / name / "scene.ply")
    errors = []
    for i, mask in read_masks(out / "masks", views).items():
        distance = torch.from_numpy(distance_transform_edt((mask < INSIDE).numpy()))
        old, new = (render_picture(scene, views[i].camera) for scene in (before, after))
        errors.append(squared_error(new, old, distance > margin))
    return psnr_from_rmse(pooled_rmse(errors) or 0)


def cell(measured: dict[str, Any], name: str, role: str | None) -> tuple[str, str]:
    """A value with its interval, and what it was measured by."""
    row = measured.get(name, {})
    row = row if role is None else row.get(role, {})
    if not row:
        return "-", ""
    number = "{:.4f}" if role is None else "{:.1f}"
    value, within = (row["excess"], row["excess_interval"]) if role is None else (
        row["value"], row["interval"]
    )  # fmt: skip
    ends = "" if within is None else f" ({number} to {number})".format(*within)
    count = f", {row['points']} of {row['matched']} points" if "points" in row else ""
    return number.format(value) + ends + count, row["against"]


def main(
    bear: Annotated[Path, typer.Argument(help="The bear, fitted from the photos.")],
    photos: Annotated[Path, typer.Argument(help="Folder of the bear's photos.")],
    out: Output,
) -> None:
    """Print a table with a row for each number."""
    write_masks(out / "masks")
    found = {name: measure(bear, photos, out, name)["measured"] for name in EDITORS}
    print_result(
        "| asked | metric | measured against | material | `small` |\n|---|---|---|---|---|"
    )
    for asked, name, role in ROWS:
        cells = [cell(found[each], name, role) for each in EDITORS]
        against = next((text for _, text in cells if text), "")
        values = " | ".join(text for text, _ in cells)
        print_result(f"| {asked} | `{name}` | {against} | {values} |")
    for margin in MARGINS:
        values = " | ".join(f"{kept(bear, out, name, margin):.1f}" for name in EDITORS)
        print_result(f"| outside, dB | | the same masks, {margin:g} pixels farther | {values} |")


if __name__ == "__main__":
    run(main)
