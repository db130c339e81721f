"""Numbers of edits beside numbers of the same edits by meters that the method does not know.

python -m research.measure_meters bear.ply ../shared/data/bear -o out/meters --write-docs

Subjects turned to bronze, as a material and by `small` with three seeds: the bear, whose masks were
drawn by hand, and synthetic scenes, whose masks are exact. OUT has the edits, the masks, and a
record of `gsedit metrics` of each. Edits and records that are there are not made again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Annotated, Any

import torch
import typer
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from gsedit.bench.provenance import provenance
from gsedit.bench.results import markdown_table, write_text
from gsedit.datasets.dataset import Dataset, capture
from gsedit.datasets.view_list_files import read_view_list
from gsedit.formats.pictures import as_picture, save_picture
from gsedit.formats.scenes import load, save
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import INSIDE, pooled_rmse, squared_error
from gsedit.scene.picture import render_picture
from gsedit.select.drawn import read_masks
from rasterizer.numerics import sh_to_color
from research.clocked import gsedit
from research.command import Output, print_result, run
from research.fit.captures import write_dataset
from research.labelled import demo_bear, statue
from research.measure_regions import DRAWN_SIZE, Case, drawn, outlines_of, synthetic_case
from research.paper.tables import write_page

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "regions.md"
EDITS = {
    "material": ((), (0,)),
    "small": (("--editor", "small"), (0, 1, 2)),
}
"""Words of `gsedit edit`, and seeds: a material has no use for more than one."""
COUNT = 50_000
"""Gaussians of the synthetic scenes."""
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
"""Distances from the masks' outlines, pixels: those on the outline are mixed."""


@dataclass(frozen=True)
class Subject:
    """A scene whose subject is edited, and whose masks are known."""

    name: str
    scene: Path
    photos: Path
    masks: Path
    sentence: str


def write_mask(mask: Float[Tensor, "h w"], file: Path) -> None:
    """Write a mask as a white picture."""
    save_picture(as_picture(mask[..., None].expand(-1, -1, 3)), file, overwrite=True)


def write_masks(folder: Path) -> None:
    """The outlines of the bear as white pictures named after their photos."""
    folder.mkdir(parents=True, exist_ok=True)
    for view in outlines_of("bear"):
        write_mask(drawn(view["outlines"], DRAWN_SIZE), folder / f"{Path(view['photo']).stem}.png")


def write_case(case: Case, folder: Path) -> Subject:
    """Write a synthetic scene, pictures of it with their cameras, and its exact masks."""
    subject = Subject(
        case.name, folder / "scene.ply", folder / "photos", folder / "masks",
        f"turn the {case.name.partition(' ')[0].rstrip(',')} into bronze",
    )  # fmt: skip
    if not subject.scene.exists():
        cameras = [viewpoint.camera for viewpoint in case.viewpoints]
        names = [f"{i:02d}" for i in range(len(cameras))]
        colors = sh_to_color(case.scene.sh[:, 0]).clamp(0, 1)
        views = capture(case.scene, cameras, names)
        write_dataset(Dataset(views, case.scene.means.double(), colors), subject.photos)
        subject.masks.mkdir(parents=True, exist_ok=True)
        for camera, mask in case.truth:
            write_mask(mask, subject.masks / f"{names[cameras.index(camera)]}.png")
        save(case.scene, subject.scene, overwrite=True)
    return subject


def subjects(bear: Path, photos: Path, out: Path) -> Iterator[Subject]:
    """The bear, the demo's bear with a scarf on a plinth, and three figures among bushes."""
    write_masks(masks := out / "bear" / "masks")
    yield Subject("bear", bear, photos, masks, "turn the bear into a bronze statue")
    made = [synthetic_case("bear, synthetic", demo_bear(COUNT), 1.0)]
    made += [synthetic_case(f"statue {seed}", statue(seed, COUNT), 0.62) for seed in range(3)]
    for case in made:
        yield write_case(case, out / case.name.replace(", ", "_").replace(" ", "_"))


def measure(subject: Subject, out: Path, editor: str, seed: int) -> dict[str, Any]:
    """The record of an edit, which is made if it is not there, by the name of each metric."""
    folder = out / subject.masks.parent.name / f"{editor}_{seed}"
    record, words = folder.with_suffix(".json"), EDITS[editor][0]
    if not record.exists():
        if not (folder / "edit.json").exists():
            gsedit(
                "edit", subject.scene, subject.sentence, "--data", subject.photos, *words,
                "--seed", seed, "-o", folder,
            )  # fmt: skip
        gsedit("metrics", folder, "--subject-masks", subject.masks, "-o", record, "--force")
    found = json.loads(record.read_text())["measured"]
    return {**found, **{str(margin): kept(subject, folder, margin) for margin in MARGINS}}


@torch.no_grad()
def kept(subject: Subject, folder: Path, margin: float) -> float:
    """PSNR to the unedited scene, dB, farther than so many pixels outside the masks' outlines."""
    views = read_view_list(folder / "views.json").viewpoints
    before, after = load(subject.scene), load(folder / "scene.ply")
    errors = []
    for i, mask in read_masks(subject.masks, views).items():
        distance = torch.from_numpy(distance_transform_edt((mask < INSIDE).numpy()))
        old, new = (render_picture(scene, views[i].camera) for scene in (before, after))
        errors.append(squared_error(new, old, distance > margin))
    return psnr_from_rmse(pooled_rmse(errors) or 0)


def cell(records: list[dict[str, Any]], name: str, role: str | None) -> tuple[str, str]:
    """The mean over seeds, with the lowest and highest, and what it was measured against."""
    found = [record.get(name, {}) for record in records]
    found = [row if role is None else row.get(role, {}) for row in found]
    if not all(found):
        return "", ""
    key, number = ("excess", "{:.4f}") if role is None else ("value", "{:.1f}")
    return _spread([row[key] for row in found], number), found[0]["against"]


def _spread(values: list[float], number: str) -> str:
    """The mean (lowest to highest); infinite decibels are of equal pictures."""
    of = (mean(values), min(values), max(values))
    words = [number.format(each).replace("inf", "equal") for each in of]
    return words[0] if words[1] == words[2] else f"{words[0]} ({words[1]} to {words[2]})"


def table(found: dict[tuple[str, str], list[dict[str, Any]]], editor: str) -> str:
    """The rows of an editor, a column a scene."""
    own = {name: records for (name, each), records in found.items() if each == editor}
    lines = []
    for asked, name, role in ROWS:
        cells = [cell(records, name, role) for records in own.values()]
        if against := next((text for _, text in cells if text), ""):
            lines.append([asked, f"`{name}`", against, *(text for text, _ in cells)])
    for margin in MARGINS:
        cells = [_spread([each[str(margin)] for each in own_], "{:.1f}") for own_ in own.values()]
        lines.append(["outside, dB", "", f"the same masks, {margin:g} pixels farther", *cells])
    return markdown_table(("asked", "metric", "measured against", *own), lines)


def main(
    bear: Annotated[Path, typer.Argument(help="The bear, fitted from the photos.")],
    photos: Annotated[Path, typer.Argument(help="Folder of the bear's photos.")],
    out: Output,
    docs: Annotated[bool, typer.Option("--write-docs", help="Write the page.")] = False,
) -> None:
    """Print a table of each editor, with a row for each number."""
    out.mkdir(parents=True, exist_ok=True)
    if not (begun := out / "conditions.txt").exists():
        write_text(begun, f"{provenance()}\n")
    records = {
        (subject.name, editor): [measure(subject, out, editor, seed) for seed in seeds]
        for subject in subjects(bear, photos, out)
        for editor, (_, seeds) in EDITS.items()
    }
    tables = {f"meters-{editor}": table(records, editor) for editor in EDITS}
    where = begun.read_text().strip()
    print_result("\n\n".join([where, *tables.values()]))
    if docs:
        found = {"meters-conditions": where, **tables}
        write_page(PAGE, found)


if __name__ == "__main__":
    run(main)
