"""`gsedit edit`: a scene and a sentence in, an edited scene and what was measured out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import ViewOptions, framed_alike, load_views
from .checkpoints import NAME, Checkpoints, Resume, going_on, run_to_result
from .command import own_flags
from .console import print_message, print_result
from .edit_options import (
    SAMPLING,
    UPDATE,
    EditorOptions,
    edit_settings,
    resolve,
    what_it_understood,
)
from .features import load_features
from .kernel import UPDATES, say_kernel
from .options import DropInvalid, Force, Scene, Seeded, check_folder, load_scene, output
from .progress import progress
from .ranks import follow, is_first, of_first, ranks
from .setting_options import SettingsGroup, Values

if TYPE_CHECKING:
    from gsedit.reports.events import Event
    from gsedit.savings.decision import Decision
    from gsedit.session.result import EditResult
    from gsedit.views.dataset import Dataset

LEFTOVERS = ("metrics.jsonl", "command")
"""Of an edit that ended before its first checkpoint: alone they are nothing to keep."""

Instruction = Annotated[
    str,
    typer.Argument(metavar="INSTRUCTION", show_default=False, help="What should change."),
]
Preset = Annotated[
    str,
    typer.Option(
        "--preset",
        metavar="default|paper",
        rich_help_panel=SAMPLING,
        help="Values of the options that are not given; paper: the published equations, which "
        "average x_(t-1) and start from independent noise, with 50 steps.",
    ),
]
Explain = Annotated[
    bool,
    typer.Option(
        "--explain",
        help="Print what the edit would leave out of the work, why, what that saves and what error "
        "it can cause at most; edit nothing. -o is not needed.",
    ),
]
Features = Annotated[
    str,
    typer.Option(
        "--features",
        metavar="filters|vgg|FILE",
        rich_help_panel=UPDATE,
        help="What the Gram loss compares: a filter bank; the VGG16 of the package stlpips_pytorch "
        "(gsedit[perceptual]); or a VGG16 of torchvision, .pth or .safetensors.",
    ),
]


def edit(
    scene: Scene,
    instruction: Instruction,
    out: Annotated[Path | None, output("Folder for the results.")] = None,
    explain: Explain = False,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    resume: Resume = False,
    *,
    views: ViewOptions,
    editor: EditorOptions,
    preset: Preset = "default",
    values: Annotated[Values, SettingsGroup(lambda: edit_settings(own_flags(edit)))],
    features: Features = "filters",
    common: Seeded,
) -> None:
    """Edit a scene from a sentence. Without --data, views are renders: from the cameras.json beside
    the scene, or else from where the scene looks as if it was captured.

    gsedit edit scene.ply "turn it into a bronze statue" --data photos/ -o out

    SCENE may be the folder of an edit, to edit its scene further; edit.json then tells the history.

    The folder gets scene.ply, cameras.json (where its views were taken from), views.json (the same
    and which were edited), region.npy (where the edit belongs), targets/ and held_out/ (edited
    views), edit.json (settings, versions, timings), metrics.jsonl (a line an event),
    before_after.png and error_vs_time.png.
    """
    folder = check_request(instruction, views, out, explain)
    result = run_edit(
        scene, instruction, folder, views=views, editor=editor, preset=preset, values=values,
        features=features, explain=explain, drop_invalid=drop_invalid, force=force, resume=resume,
        common=common,
    )  # fmt: skip
    if result is not None:
        print_edit(result, folder, as_json=common.json)


def run_edit(
    scene: Path,
    instruction: str,
    folder: Path,
    *,
    views: ViewOptions,
    editor: EditorOptions,
    preset: str = "default",
    values: Values | None = None,
    features: str = "filters",
    explain: bool = False,
    drop_invalid: bool = False,
    force: bool = False,
    resume: bool = False,
    common: Seeded,
) -> EditResult | None:
    """Edit with progress on the terminal, and write the folder; None on all ranks but the first,
    and where the edit is only explained."""
    kept = {"editor": editor, "features": features}
    state = None
    if not explain:
        check_apart(scene, folder)
        state = of_first(lambda: going_on(folder / NAME, kept, "edit", resume=resume, force=force))
        check_folder(folder, force or state is not None, leftovers=LEFTOVERS)
    common.apply()

    from gsedit.edit import edit_steps
    from gsedit.edit import explain as plan_of
    from gsedit.session.history import history_of
    from gsedit.strategies import asks_editor, check_strategy

    settings, strategy = resolve(preset, values or {}, own_flags(edit))
    check_strategy(strategy)
    check_condition(settings.condition, views.data)
    followed = instruction if asks_editor(strategy) else None
    editor_2d = editor.make(folder, followed)
    extractor = load_features(features)
    gaussians = load_scene(scene, drop_invalid=drop_invalid)
    say_kernel(settings.execution, UPDATES)
    dataset = framed_alike(load_views(scene, gaussians, views, settings.execution))
    asked = {
        "dataset": dataset, "editor": editor_2d, "settings": settings, "strategy": strategy,
        "features": extractor, "generator": common.generator(),
    }  # fmt: skip
    if explain:
        return print_plan(plan_of(gaussians, instruction, **asked), as_json=common.json)
    steps = edit_steps(gaussians, instruction, **asked, resume=state, ranks=ranks())
    if not is_first():
        return follow(steps)
    if followed and (understood := what_it_understood(editor_2d, followed)):
        print_message(understood)
    request = {
        "scene": scene, "drop_invalid": drop_invalid, **asdict(views), "editor": editor,
        "preset": preset, "features": features, "seed": common.seed, "ranks": ranks().size,
        **history_of(scene),
    }  # fmt: skip
    earlier = [] if state is None else state.record["events"]
    return run_and_write(steps, folder, dataset, request, kept, earlier, as_json=common.json)


def print_edit(result: EditResult, folder: Path, *, as_json: bool) -> None:
    """Print where the edited scene is."""
    record = {
        "folder": folder,
        "scene": folder / "scene.ply",
        "ground_truth": result.quality.psnr_to_ground_truth,
        "kept": result.quality.kept,
    }
    print_result(record, str(folder / "scene.ply"), as_json=as_json)


def write_cameras_and_views(dataset: Dataset, result: EditResult, folder: Path) -> None:
    """The cameras that other commands read, and the list of views that gsedit metrics measures
    at."""
    from gsedit.files.cameras import write_cameras
    from gsedit.files.view_lists import write_view_list
    from gsedit.views.view_list import by_edit
    from gsedit.views.viewpoints import viewpoints_of

    edited = {view.name for view in result.originals}
    write_cameras(dataset.views, folder / "cameras.json", overwrite=True)
    write_view_list(by_edit(viewpoints_of(dataset), edited), folder / "views.json", overwrite=True)


def copy_frame(scene: Path, folder: Path) -> None:
    """What lies beside the scene and says which frame it is in: the edited scene is in the same."""
    from gsedit.files.dataparser import NAME, dataparser_file, read_dataparser, write_dataparser

    file = dataparser_file(scene)
    if file is not None:
        write_dataparser(read_dataparser(file), folder / NAME)
    else:
        (folder / NAME).unlink(missing_ok=True)  # an earlier run's


def print_plan(decisions: tuple[Decision, ...], *, as_json: bool) -> None:
    """Print what an edit would leave out."""
    from gsedit.savings.decision import screen

    record = {"decisions": decisions}
    text = screen(decisions) or "nothing is decided: --no-plan does everything"
    print_result(record, text, as_json=as_json)


def check_request(instruction: str, views: ViewOptions, out: Path | None, explain: bool) -> Path:
    """The folder for the results. Raises UsageError for what needs no file to be found wrong."""
    from gsedit.errors import UsageError

    if not instruction.strip():
        raise UsageError("the instruction is empty: say what should change, as in 'make it snow'")
    views.check()
    if explain:
        return out or Path()
    if out is None:
        raise UsageError("-o is missing: name a folder for the results, or add --explain")
    return out


def check_apart(scene: Path, out: Path) -> None:
    """Raise UsageError where the results would be written over the edit that is edited."""
    from gsedit.errors import UsageError

    if scene.absolute() == (out / "scene.ply").absolute():
        raise UsageError(f"-o {out} is the folder of the scene that is edited: name another")


def check_condition(condition: str, data: Path | None) -> None:
    """Raise UsageError where the editor is to be shown photos and there are none."""
    from gsedit.errors import UsageError

    if condition == "photo" and data is None:
        raise UsageError("--condition photo shows the editor the photos: name them with --data")


def run_and_write(
    steps: Iterable[Any],
    out: Path,
    dataset: Dataset,
    request: Mapping[str, Any],
    asked: Mapping[str, Any],
    earlier: Iterable[Mapping[str, Any]],
    *,
    as_json: bool,
) -> EditResult:
    """Run an edit, showing its events; its result, written to the folder `out`.

    Until then the folder keeps the events so far, from the `earlier` ones of the edit that goes on,
    and the last checkpoint.
    """
    from gsedit.reports.events import Event
    from gsedit.reports.journal import event_journal
    from gsedit.reports.tables import table
    from gsedit.session.folder import write_edit

    journal = event_journal(out / "metrics.jsonl", [Event(**event) for event in earlier])
    source = {"scene": request["scene"].absolute(), "drop_invalid": request["drop_invalid"]}
    checkpoints = Checkpoints(out / NAME, asked, source)
    with checkpoints:
        with progress(as_json=as_json) as show:

            def write_and_show(event: Event) -> None:
                journal.write(event)
                show(event)

            result = run_to_result(steps, write_and_show, checkpoints)
        write_cameras_and_views(dataset, result, out)
        copy_frame(request["scene"], out)
        write_edit(out, result, request=request, overwrite=True)
    print_message(table(journal.records))
    print_message(result.quality.describe())
    print_message(
        f"results are in {out}; look at {out / 'before_after.png'}, then: "
        f"gsedit preview {out / 'scene.ply'}"
    )
    return result
