"""`gsedit metrics`: how good an edited or fitted scene is, in numbers that two people share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gsedit.errors import InputError, UsageError
from rasterizer.numerics import Execution

from ..core.command import Values, argument, option, shows, with_values
from ..core.console import as_json, print_json, print_message, shown
from ..core.kernel import say_kernel
from ..core.outputs import check_file
from ..core.progress import counting
from ..options.cameras import ViewOptions, resolve_cameras
from ..options.common import Data, Reads, Writes, load_scene
from .render import RENDER_SETTINGS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from torch import Tensor

    from gsedit.measures.against import Reference
    from gsedit.measures.agreement import Pictures
    from gsedit.measures.metrics import EvaluationInput
    from gsedit.select.region import Region
    from gsedit.views.view_list_files import ViewList
    from rasterizer.scene import Gaussians

Scene = Annotated[
    Path,
    argument(
        "SCENE",
        "The scene to measure, or the folder of an edit: its scene.ply, against that folder.",
    ),
]


@dataclass(frozen=True)
class MetricsOptions(Writes, Data):
    """Options of `gsedit metrics`: what a scene is measured against and at, and the files."""

    out: Path | None = option(None, "PATH", flags="--output -o")
    """JSON file to write the record to."""
    against: Path | None = option(None, "SCENE|FOLDER")
    """The unedited scene; or the folder of an edit (its unedited scene, region, views and edited
    pictures); or photos (nerfstudio or COLMAP); or pictures named after the views."""
    region: str | None = option(None, "REGION")
    """Place where the edit belonged, for the leakage: region.npy, box:..., sphere:... or all. None:
    the edit's."""
    subject_masks: Path | None = option(None, "FOLDER")
    """Masks that the edit did not know, to measure outside of: a PNG named after each view that has
    one, white where the edit belongs. Those of views that are not measured are left aside."""
    views: Path | None = option(None, "FILE.json")
    """List of views to measure at, see --save-views."""
    save_views: Path | None = option(None, "FILE.json")
    """Write the list of views, for others to measure the same."""
    size: int | None = option(None, "PIXELS", min=16)
    """Longer side of the views at most; listed ones keep theirs otherwise, others have 256."""
    picture: Path | None = option(None, "FILE.png")
    """Also draw the views side by side, with their differences."""


@shows(
    "--output", "--against", "--region", "--subject-masks", "--data", "--views", "--save-views",
    "--size", "--picture", "--force",
)  # fmt: skip
def metrics(
    scene: Scene, *, reads: Reads, own: MetricsOptions, values: Annotated[Values, RENDER_SETTINGS]
) -> None:
    """Measure a scene against the unedited one, edited pictures or photos.

    gsedit metrics out/bronze

    gsedit metrics out/bronze --subject-masks drawn/ --json

    gsedit metrics bear.ply --against photos/ --save-views views.json

    docs/reference/metrics.md defines every measure.
    """
    scene, reference = what_to_measure(scene, own.against)
    for path, suffix in (
        (own.out, ".json"), (own.save_views, ".json"), (own.picture, ".png"),
    ):  # fmt: skip
        check_file(path, own.force, suffix)

    from gsedit.measures.against import resolve_reference
    from gsedit.views.view_list_files import write_view_list

    found = resolve_reference(reference)
    check_views(found, own)
    say_kernel(with_values(Execution(), values))
    subject = gather(scene, found, own, reads.drop_invalid)
    if own.save_views is not None:
        write_view_list(subject.views, own.save_views, overwrite=own.force)
        print_message(f"the list of views is {own.save_views}")
    request = {
        "scene": scene, "against": found.path, "against_is": found.kind, "region": own.region,
        "subject_masks": own.subject_masks,
        "listed_views": own.views, "size": own.size,
    }  # fmt: skip
    measure_and_show(subject, found, request, own)


def measure_and_show(
    subject: EvaluationInput, against: Reference, request: dict[str, Any], own: MetricsOptions
) -> None:
    """Measure, write the files, and print the table or the record."""
    from gsedit.measures.evaluation import evaluate, evaluation_record, evaluation_table
    from gsedit.pictures.contact_sheet import difference_sheet
    from gsedit.run.json_lines import write_record

    with counting("measure") as tell:
        evaluation = evaluate(subject, tell)
    record = evaluation_record(evaluation, request, against)
    if own.out is not None:
        write_record(record, own.out, overwrite=own.force)
        print_message(f"the record is {own.out}")
    if own.picture is not None:
        difference_sheet(subject, own.picture, against.targets, overwrite=own.force)
        print_message(f"the pictures are {own.picture}")
    if as_json.get():
        print_json("metrics", record)
    else:
        typer.echo(shown(evaluation_table(evaluation, against)))


def what_to_measure(scene: Path, against: Path | None) -> tuple[Path, Path]:
    """(file of the scene, what it is compared with). Raises UsageError without the latter, and
    InputError for a scene that is not there."""
    from gsedit.measures.against import UNFINISHED

    if not scene.exists():
        raise InputError(f"{scene}: no such file or folder")
    if scene.is_dir():
        if not (scene / "edit.json").is_file() and not (scene / UNFINISHED).is_file():
            raise UsageError(f"{scene} is no folder of an edit (no edit.json): name a scene file")
        return scene / "scene.ply", scene if against is None else against
    if against is None:
        raise UsageError(
            "nothing to compare with: add --against with the unedited scene, the folder of the "
            "edit, photos or pictures"
        )
    return scene, against


def check_views(against: Reference, own: MetricsOptions) -> None:
    """Raise UsageError where the views are given twice, or nothing says what pictures show."""
    if own.data is not None and (own.views is not None or against.kind in ("edit", "photos")):
        giver = "--views" if own.views is not None else f"--against {against.path}"
        raise UsageError(f"{giver} already says which views: leave out --data")
    if against.kind == "pictures" and own.data is None and own.views is None:
        raise UsageError(
            f"nothing says from where the pictures in {against.path} were taken: add --views with "
            "a list of views, or --data with the photos' folder"
        )
    if against.kind == "edit" and against.views is None and own.views is None:
        raise UsageError(f"{against.path} has no views.json: add --views with a list")


def gather(
    path: Path, against: Reference, own: MetricsOptions, drop_invalid: bool
) -> EvaluationInput:
    """Read everything that is measured."""
    from gsedit.capture.matches import match_pictures
    from gsedit.measures.against import find_alone
    from gsedit.measures.metrics import REGION_IS, EvaluationInput
    from gsedit.select.masked import read_masks

    drawn = own.subject_masks
    scene = load_scene(path, drop_invalid=drop_invalid)
    unedited = None
    if against.unedited is not None:
        unedited = load_scene(against.unedited, drop_invalid=drop_invalid or against.drop_invalid)
    known, after = regions_of(against, own.region, unedited, scene)
    views, targets, masks = place_views(path, scene, against, unedited, own)
    given = {} if drawn is None else read_masks(drawn, views.viewpoints, others=True)
    if drawn is not None and (left := len(list(drawn.glob("*.png"))) - len(given)) > 0:
        print_message(f"{left} masks in {drawn} are of no view that is measured: left aside")
    return EvaluationInput(
        scene,
        views,
        targets,
        against.why_no_pictures,
        targets_are=against.pictures_are,
        edits_alone=find_alone(against, views),
        unedited=unedited,
        region=known,
        region_is=REGION_IS if own.region is None else "the region that was given",
        subject_masks=given,
        matcher=match_pictures,
        edited_region=after,
        masks=masks,
    )


def known(region: str) -> str:
    """Return a region to measure with. Raises UsageError for one that has to be looked for."""
    from gsedit.select.where import check_region

    if check_region(region).question is not None and not region.lower().endswith(".npy"):
        raise UsageError(
            f"region {region} has to be looked for, and a region to measure with must be known: "
            "give the region.npy that gsedit edit wrote, a box or a sphere"
        )
    return region


def regions_of(
    against: Reference, named: str | None, unedited: Gaussians | None, edited: Gaussians
) -> tuple[Region | None, Region | None]:
    """The region that is named, else an edit's: before, and after where it moved objects; then one
    of them may be empty."""
    import torch

    from gsedit.formats.flags import read_flags
    from gsedit.select.finder import Finder
    from gsedit.select.region import Region

    before, after = against.region, against.edited_region
    if unedited is None and named is not None:
        print_message("--region needs the unedited scene to compare with: it is not used")
    if unedited is None or (named is None and before is None):
        return None, None
    if named is not None or before is None or after is None:
        return Finder(unedited).select(known(named or str(before))), None
    pairs = ((before, unedited), (after, edited))
    one, other = (
        Region(torch.from_numpy(read_flags(file, len(scene))), str(file)) for file, scene in pairs
    )
    return one, other


def place_views(
    path: Path,
    scene: Gaussians,
    against: Reference,
    unedited: Gaussians | None,
    own: MetricsOptions,
) -> tuple[ViewList, Pictures, Mapping[int, Tensor]]:
    """The views, the pictures that the scene should show at them, and the masks of these."""
    from gsedit.measures.against import find_pictures, resized
    from gsedit.views.cameras_json import cameras_file
    from gsedit.views.view_list_files import by_capture, read_view_list, with_roles_of
    from gsedit.views.viewpoints import rendered, viewpoints_of

    given = read_view_list(own.views) if own.views is not None else against.views
    size = own.size or 256  # as of `gsedit edit`
    if given is not None and against.kind != "photos":
        views = resized(given, own.size)
        return views, find_pictures(against, views), {}
    of_photos = against.path if against.kind == "photos" else own.data
    # cameras beside the unedited scene: those of edited ones may differ from edit to edit
    beside_own = against.kind != "scene" or (cameras_file(path) and not cameras_file(against.path))
    place, seen = (path, scene) if beside_own or unedited is None else (against.path, unedited)
    options = ViewOptions(of_photos, size=size)
    found = resolve_cameras(place, seen, options)
    dataset = found.photos or rendered(seen, found.some(seen))
    views = by_capture(viewpoints_of(dataset))
    if against.kind != "photos":
        return views, find_pictures(against, views), {}
    photos = {i: view.image for i, view in enumerate(dataset.views)}
    masks = {i: mask for i, view in enumerate(dataset.views) if (mask := view.mask) is not None}
    return (views if given is None else with_roles_of(given, views)), photos, masks
