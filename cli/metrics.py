"""`gsedit metrics`: how good an edited or fitted scene is, in numbers that two people share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import ViewOptions, load_views
from .console import print_json, print_message
from .kernel import say_kernel
from .options import (
    Common,
    Data,
    DropInvalid,
    Force,
    check_file,
    load_scene,
    output,
)
from .progress import progress
from .render import render_settings
from .setting_options import SettingsGroup, Values, with_values

if TYPE_CHECKING:
    from collections.abc import Mapping

    from torch import Tensor

    from gsedit.measures.against import Against
    from gsedit.measures.agreement import Pictures
    from gsedit.measures.subject import Subject
    from gsedit.views.view_list import ViewList
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians

VIEWS, WORDS = "Views", "Measures with words"
DEFAULT_SIZE = 256
"""Longer side of views that are not listed, pixels, as of `gsedit edit`."""

Scene = Annotated[
    Path,
    typer.Argument(
        metavar="SCENE",
        show_default=False,
        help="The scene to measure, or the folder of an edit: its scene.ply, against that folder.",
    ),
]
AgainstPath = Annotated[
    Path | None,
    typer.Option(
        "--against",
        metavar="SCENE|FOLDER",
        show_default=False,
        help="The unedited scene; or the folder of an edit (its unedited scene, region, views and "
        "edited pictures); or photos (nerfstudio or COLMAP); or pictures named after the views.",
    ),
]
Region = Annotated[
    str | None,
    typer.Option(
        "--region",
        metavar="REGION",
        show_default="the edit's",
        help="Where the edit belonged, for the leakage: region.npy, box:..., sphere:... or all.",
    ),
]


def view_option(name: str, help: str, **more: Any) -> Any:
    return typer.Option(name, help=help, rich_help_panel=VIEWS, show_default=False, **more)


def word_option(name: str, help: str, **more: Any) -> Any:
    return typer.Option(name, help=help, rich_help_panel=WORDS, show_default=False, **more)


@dataclass(frozen=True)
class Outputs:
    """The files of a measurement besides what is printed."""

    out: Annotated[Path | None, output("JSON file to write the record to.")] = None
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture",
            metavar="FILE.png",
            show_default=False,
            help="Also draw the views side by side, with their differences.",
        ),
    ] = None
    force: Force = False


@dataclass(frozen=True)
class ListedViews:
    """Which views are measured at."""

    views: Annotated[
        Path | None,
        view_option(
            "--views",
            "List of views to measure at, see --save-views.",
            metavar="FILE.json",
        ),
    ] = None
    save_views: Annotated[
        Path | None,
        view_option(
            "--save-views", "Write the list of views, for others to measure the same.",
            metavar="FILE.json",
        ),
    ] = None  # fmt: skip
    data: Data = None
    size: Annotated[
        int | None,
        view_option(
            "--size", "Longer side of the views at most; listed ones keep theirs otherwise, others "
            "have 256.", min=16, metavar="PIXELS",
        ),
    ] = None  # fmt: skip


@dataclass(frozen=True)
class WordOptions:
    """What pictures are compared to in words, and by what."""

    clip: Annotated[
        Path | None,
        word_option(
            "--clip", "Folder of a CLIPModel of transformers (config.json, model.safetensors, "
            "tokenizer).", metavar="DIR",
        ),
    ] = None  # fmt: skip
    instruction: Annotated[
        str | None, word_option("--instruction", "What the edit was asked for; an edit's own.")
    ] = None
    source_caption: Annotated[
        str | None,
        word_option("--source-caption", 'What the unedited scene shows: "a photo of a bear".'),
    ] = None
    target_caption: Annotated[
        str | None,
        word_option("--target-caption", 'What it should show: "a photo of a bronze bear".'),
    ] = None


def metrics(
    scene: Scene,
    against: AgainstPath = None,
    region: Region = None,
    drop_invalid: DropInvalid = False,
    *,
    outputs: Outputs,
    listed: ListedViews,
    words: WordOptions,
    values: Annotated[Values, SettingsGroup(render_settings)],
    common: Common,
) -> None:
    """Measure a scene beside the unedited one, edited pictures or photos. docs/metrics.md has every
    formula.

    gsedit metrics out/bronze

    gsedit metrics edited.ply --against bear.ply --views views.json --json

    gsedit metrics bear.ply --against photos/ --save-views views.json
    """
    scene, reference = what_to_measure(scene, against)
    check_files(
        (outputs.out, ".json"), (listed.save_views, ".json"), (outputs.picture, ".png"),
        force=outputs.force,
    )  # fmt: skip
    common.apply()

    from gsedit.files.view_lists import write_view_list
    from gsedit.measures.against import find_against
    from rasterizer.numerics import Execution

    found = find_against(reference)
    check_views(found, listed)
    execution = with_values(Execution(), values)
    subject = gather(scene, found, region, listed, words, drop_invalid, execution)
    if listed.save_views is not None:
        write_view_list(subject.views, listed.save_views, overwrite=outputs.force)
        print_message(f"the list of views is {listed.save_views}")
    request = {
        "scene": scene, "against": found.path, "against_is": found.kind, "region": region,
        "listed_views": listed.views, "size": listed.size, "texts": subject.texts,
        "clip": words.clip,
    }  # fmt: skip
    measure_and_show(subject, found, request, outputs, as_json=common.json)


def measure_and_show(
    subject: Subject, against: Against, request: dict[str, Any], outputs: Outputs, *, as_json: bool
) -> None:
    """Measure, write the files, and print the table or the record."""
    from gsedit.measures.evaluation import evaluate
    from gsedit.reports.difference_sheet import difference_sheet
    from gsedit.reports.evaluation_table import evaluation_record, evaluation_table
    from gsedit.reports.events import Event
    from gsedit.reports.json_lines import write_record
    from gsedit.reports.stopwatch import Stopwatch

    watch = Stopwatch()
    with progress(as_json=as_json) as show:
        evaluation = evaluate(
            subject, lambda done, total: show(Event("measure", watch.seconds, done, total))
        )
    record = evaluation_record(evaluation, request, against)
    if outputs.out is not None:
        write_record(record, outputs.out, overwrite=outputs.force)
        print_message(f"the record is {outputs.out}")
    if outputs.picture is not None:
        difference_sheet(subject, outputs.picture, against.targets, overwrite=outputs.force)
        print_message(f"the pictures are {outputs.picture}")
    if as_json:
        print_json("metrics", record)
    else:
        typer.echo(evaluation_table(evaluation, against))


def what_to_measure(scene: Path, against: Path | None) -> tuple[Path, Path]:
    """(file of the scene, what it is compared with). Raises UsageError without the latter, and
    InputError for a scene that is not there."""
    from gsedit.errors import InputError, UsageError

    if not scene.exists():
        raise InputError(f"{scene}: no such file or folder")
    if scene.is_dir():
        if not (scene / "edit.json").is_file() and not (scene / "metrics.jsonl").is_file():
            raise UsageError(f"{scene} is no folder of an edit (no edit.json): name a scene file")
        return scene / "scene.ply", scene if against is None else against
    if against is None:
        raise UsageError(
            "nothing to compare with: add --against with the unedited scene, the folder of the "
            "edit, photos or pictures"
        )
    return scene, against


def check_files(*files: tuple[Path | None, str], force: bool) -> None:
    """Raise UsageError for a file that cannot be written, or has another suffix."""
    from gsedit.errors import UsageError

    for path, suffix in files:
        if path is not None:
            if path.suffix.lower() != suffix:
                raise UsageError(f"{path}: name a {suffix} file")
            check_file(path, force)


def check_views(against: Against, listed: ListedViews) -> None:
    """Raise UsageError where the views are given twice, or nothing says what pictures show."""
    from gsedit.errors import UsageError

    if listed.data is not None and (listed.views is not None or against.kind in ("edit", "photos")):
        giver = "--views" if listed.views is not None else f"--against {against.path}"
        raise UsageError(f"{giver} already says which views: leave out --data")
    if against.kind == "pictures" and listed.data is None and listed.views is None:
        raise UsageError(
            f"nothing says from where the pictures in {against.path} were taken: add --views with "
            "a list of views, or --data with the photos' folder"
        )
    if against.kind == "edit" and against.views is None and listed.views is None:
        raise UsageError(
            f"{against.path} has neither views.json nor cameras.json: add --views with a list"
        )


def gather(
    path: Path,
    against: Against,
    region: str | None,
    listed: ListedViews,
    words: WordOptions,
    drop_invalid: bool,
    execution: Execution,
) -> Subject:
    """Read everything that is measured."""
    from gsedit.measures.clip import load_clip
    from gsedit.measures.conse import load_conse
    from gsedit.measures.subject import Subject, Texts
    from gsedit.regions.known import known_region

    clip = None if words.clip is None else load_clip(words.clip)
    scene = load_scene(path, drop_invalid=drop_invalid)
    unedited = None
    if against.unedited is not None:
        unedited = load_scene(against.unedited, drop_invalid=drop_invalid or against.drop_invalid)
    named = region or (None if against.region is None else str(against.region))
    known = None if named is None or unedited is None else known_region(named, unedited)
    say_kernel(execution)
    views, targets, masks = place_views(path, scene, against, unedited, listed, execution)
    if region is not None and unedited is None:
        print_message("--region is for the leakage, which needs the unedited scene: it is not used")
    return Subject(
        scene,
        views,
        targets,
        against.why_no_pictures,
        unedited,
        known,
        Texts(words.instruction or against.instruction, words.source_caption, words.target_caption),
        clip,
        load_conse(),
        execution,
        masks,
    )


def place_views(
    path: Path,
    scene: Gaussians,
    against: Against,
    unedited: Gaussians | None,
    listed: ListedViews,
    execution: Execution,
) -> tuple[ViewList, Pictures, Mapping[int, Tensor]]:
    """The views, the pictures that the scene should show at them, and the masks of these."""
    from gsedit.files.cameras import cameras_file
    from gsedit.files.view_lists import read_view_list
    from gsedit.measures.against import find_pictures, resized
    from gsedit.views.view_list import by_capture, with_roles_of
    from gsedit.views.viewpoints import viewpoints_of

    given = read_view_list(listed.views) if listed.views is not None else against.views
    size = listed.size or DEFAULT_SIZE
    if given is not None and against.kind != "photos":
        views = resized(given, listed.size)
        return views, find_pictures(against, views), {}
    of_photos = against.path if against.kind == "photos" else listed.data
    # cameras beside the unedited scene: those of edited ones may differ from edit to edit
    beside_own = against.kind != "scene" or (cameras_file(path) and not cameras_file(against.path))
    place, seen = (path, scene) if beside_own or unedited is None else (against.path, unedited)
    dataset = load_views(place, seen, ViewOptions(of_photos, size), execution)
    views = by_capture(viewpoints_of(dataset))
    if against.kind != "photos":
        return views, find_pictures(against, views), {}
    photos = {i: view.image for i, view in enumerate(dataset.views)}
    masks = {i: mask for i, view in enumerate(dataset.views) if (mask := view.mask) is not None}
    return (views if given is None else with_roles_of(given, views)), photos, masks
