"""`gsedit edit`: a scene and a sentence in, an edited scene and its evidence out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import Up, check_axis, up_vector
from .checkpoints import Checkpoints, run_to_result
from .console import print_message, print_result
from .edit_options import (
    SAMPLER,
    UPDATE,
    EditorOptions,
    Preset,
    RoundOptions,
    SamplerOptions,
    UpdateOptions,
    option,
    resolve,
)
from .options import (
    Compile,
    Data,
    DropInvalid,
    Force,
    Scene,
    Seeded,
    Size,
    check_folder,
    output,
    read,
)
from .progress import progress

if TYPE_CHECKING:
    from gsedit.reports.events import Event
    from gsedit.session.result import EditResult
    from gsedit.views.dataset import Dataset
    from rasterizer.scene import Gaussians


def edit(
    scene: Scene,
    instruction: Annotated[
        str, typer.Argument(metavar="INSTRUCTION", show_default=False, help="What should change.")
    ],
    out: Annotated[Path, output("Folder for the results.")],
    data: Data = None,
    size: Size = 256,
    up: Up = None,
    *,
    chosen: EditorOptions,
    preset: Annotated[
        Preset,
        typer.Option(
            "--preset",
            rich_help_panel=SAMPLER,
            help="Where sampling starts from; paper: the equations as printed, 50 steps.",
        ),
    ] = Preset.default,
    sampler: SamplerOptions,
    update: UpdateOptions,
    plan: RoundOptions,
    vgg: Annotated[
        Path | None,
        option(
            "--vgg",
            "Gram on VGG16 features: torchvision's weights (.pth, .safetensors).",
            metavar="FILE",
            rich_help_panel=UPDATE,
        ),
    ] = None,
    compile: Compile = False,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    common: Seeded,
) -> None:
    """Edit a scene from a sentence; without --data, cameras are placed around it.

    gsedit edit scene.ply "turn it into a bronze statue" --data photos/ -o out

    The folder gets scene.ply, edit.json (settings, versions, timings), metrics.jsonl (a line an
    event), before_after.png and error_vs_time.png.
    """
    from gsedit.errors import UsageError

    if not instruction.strip():
        raise UsageError("the instruction is empty: say what should change, as in 'make it snow'")
    check_axis(up)
    check_folder(out, force)
    common.apply()

    from gsedit.edit import edit_steps
    from gsedit.reports.journal import event_journal

    settings, strategy = resolve(preset, sampler, update, plan, compile=compile)
    editor = chosen.make(out)
    editor.check(instruction)
    features = _vgg(vgg)
    found = read(scene, drop_invalid=drop_invalid)
    dataset = load_views(data, found, size, up)

    journal = event_journal(out / "metrics.jsonl")
    checkpoints = Checkpoints(
        out / "checkpoint.ply",
        "it is a whole scene, edited so far; add -f to run the edit again from the start",
    )
    with checkpoints:
        with progress(as_json=common.json) as show:
            steps = edit_steps(
                found,
                instruction,
                dataset=dataset,
                editor=editor,
                settings=settings,
                strategy=strategy,
                features=features,
                generator=common.generator(),
            )

            def write_and_show(event: Event) -> None:
                journal.write(event)
                show(event)

            result = run_to_result(steps, write_and_show, checkpoints)
        request = {
            "instruction": instruction,
            "scene": scene,
            "drop_invalid": drop_invalid,
            "data": data,
            "size": size,
            "up": up,
            "editor": chosen,
            "preset": preset.value,
            "vgg": vgg,
            "seed": common.seed,
        }
        write_results(out, result, journal.records, request)
    explain_results(out, journal.records)
    record = {"folder": out, "scene": out / "scene.ply", "ground_truth": result.ground_truth}
    print_result(record, str(out / "scene.ply"), as_json=common.json)


def write_results(
    out: Path, result: EditResult, events: list[Event], request: dict[str, Any]
) -> None:
    """Every file of the folder, each whole or not at all; edit.json last, so that it seals them."""
    import json

    from gsedit.files import atomic_path, save
    from gsedit.files.pictures import save_picture
    from gsedit.reports.contact_sheet import contact_sheet
    from gsedit.reports.figures import error_vs_time
    from gsedit.reports.json_lines import plain

    (out / "edit.json").unlink(missing_ok=True)  # an earlier run's: it would seal mixed files
    save(result.scene, out / "scene.ply", overwrite=True)
    rows = (
        ("original", result.originals),
        (f"2D targets: {request['instruction']}", result.targets),
        ("edited scene", result.finals),
    )
    save_picture(contact_sheet(rows), out / "before_after.png", overwrite=True)
    error_vs_time(events, out / "error_vs_time.png", overwrite=True)
    record = {
        **request,
        "settings": result.settings,
        "strategy": result.strategy,
        "timings": result.timings,
        "gaussians": len(result.scene),
        "edited_views": [view.name for view in result.targets],
        "measured": {
            "matched": result.matched,
            "pairs": result.pairs,
            "coverage": result.plan.coverage[-1],
            "strength": result.strength,
            "residual": result.residual,
            "ground_truth": result.ground_truth,
        },
        **surroundings(),
    }
    with atomic_path(out / "edit.json", overwrite=True) as temporary:
        temporary.write_text(json.dumps(plain(record), indent=2, allow_nan=False) + "\n")


def surroundings() -> dict[str, Any]:
    """What else decides the result: versions and threads."""
    import platform
    from importlib.metadata import version

    import torch

    return {
        "versions": {name: version(name) for name in ("gsedit", "torch", "numpy", "kornia")},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": torch.get_num_threads(),
    }


def explain_results(out: Path, events: list[Event]) -> None:
    from gsedit.reports.tables import table

    print_message(table(events))
    print_message(
        f"results are in {out}; look at {out / 'before_after.png'}, then: "
        f"gsedit preview {out / 'scene.ply'}"
    )


def _vgg(path: Path | None) -> Any:
    if path is None:
        return None
    from gsedit.measures.features import Vgg16

    return Vgg16(path)


def load_views(data: Path | None, scene: Gaussians, size: int, up: str | None) -> Dataset:
    """The photos, or pictures of the scene from around it where there are none."""
    if data is not None:
        from gsedit.files import load_dataset

        return load_dataset(data, size=size)
    from gsedit.edit import around

    return around(scene, size, up_vector(up))
