"""`gsedit edit`: a scene and a sentence in, an edited scene and its evidence out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import Up, around, check_axis
from .narrate import Checkpoints, answer, follow, narrator, plain, say
from .options import (
    Data,
    DropInvalid,
    Force,
    Scene,
    Seeded,
    Size,
    check_folder,
    given,
    output,
    read,
)

if TYPE_CHECKING:
    from gsedit.edit import EditResult, EditSettings
    from gsedit.report import Event
    from gsedit.views import Dataset
    from rasterizer.scene import Gaussians


class EditorName(str, Enum):
    closed_form = "closed-form"
    pix2pix = "pix2pix"


class Preset(str, Enum):
    default = "default"
    paper = "paper"


class Geometry(str, Enum):
    appearance = "appearance"
    full = "full"


class Condition(str, Enum):
    render = "render"
    photo = "photo"


def option(name: str, help: str, **more: Any) -> Any:
    """An option whose default is the library's, so it is only told here, not set."""
    return typer.Option(name, help=help, show_default=False, **more)


EDITOR, SAMPLER, UPDATE = "The 2D editor", "How it samples", "How the scene follows"


@dataclass(frozen=True)
class EditorOptions:
    """Which 2D editor follows the instruction."""

    editor: Annotated[
        EditorName,
        typer.Option(
            "--editor",
            rich_help_panel=EDITOR,
            help="closed-form: built in, knows a list of looks; pix2pix: InstructPix2Pix weights.",
        ),
    ] = EditorName.closed_form
    model: Annotated[
        str | None,
        option("--model", "pix2pix: a folder of weights, or a hub id.", rich_help_panel=EDITOR),
    ] = None
    weights_dir: Annotated[
        Path | None,
        option("--weights-dir", "pix2pix: where weights are kept.", rich_help_panel=EDITOR),
    ] = None


@dataclass(frozen=True)
class SamplerOptions:
    """Fields of gsedit.diffusion.SamplerSettings; None leaves the preset's value."""

    steps: Annotated[
        int | None,
        option("--steps", "Sampling steps (default 20).", rich_help_panel=SAMPLER),
    ] = None
    guidance_text: Annotated[
        float | None,
        option(
            "--guidance", "How strongly the instruction (default 7.5).", rich_help_panel=SAMPLER
        ),
    ] = None
    guidance_image: Annotated[
        float | None,
        option(
            "--image-guidance", "... and the picture hold (default 1.5).", rich_help_panel=SAMPLER
        ),
    ] = None
    consensus: Annotated[
        bool | None,
        option(
            "--consensus/--no-consensus",
            "Views agree on corresponding cells while they are sampled (default yes).",
            rich_help_panel=SAMPLER,
        ),
    ] = None


@dataclass(frozen=True)
class UpdateOptions:
    """Fields of gsedit.strategies.UpdateSettings; None leaves the library's value."""

    update_steps: Annotated[
        int | None,
        option("--update-steps", "Fitting steps a round (default 200).", rich_help_panel=UPDATE),
    ] = None
    patches: Annotated[
        int | None,
        option("--patches", "Crops rendered a step (default 4).", rich_help_panel=UPDATE),
    ] = None
    patch: Annotated[
        int | None,
        option("--patch", "Side of a crop, pixels (default 64).", rich_help_panel=UPDATE),
    ] = None
    gram_weight: Annotated[
        float | None,
        option("--gram-weight", "Weight of the Gram loss (default 0.1).", rich_help_panel=UPDATE),
    ] = None


@dataclass(frozen=True)
class RoundOptions:
    """Fields of gsedit.edit.EditSettings; None leaves the library's value."""

    views_per_round: Annotated[
        int | None,
        option("--views", "Views edited together in a round (default 4).", rich_help_panel=UPDATE),
    ] = None
    rounds: Annotated[
        int | None, option("--rounds", "Rounds at most (default 2).", rich_help_panel=UPDATE)
    ] = None
    coverage: Annotated[
        float | None,
        option(
            "--coverage",
            "Stop when this share of what the cameras see was edited (default 0.95).",
            rich_help_panel=UPDATE,
        ),
    ] = None
    geometry: Annotated[
        Geometry | None,
        option(
            "--geometry",
            "Move colours and opacities only, or everything (default appearance).",
            rich_help_panel=UPDATE,
        ),
    ] = None
    condition: Annotated[
        Condition | None,
        option(
            "--condition",
            "What the editor is shown as the unedited picture (default render).",
            rich_help_panel=UPDATE,
        ),
    ] = None


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
    from gsedit.editors import make_editor

    settings = resolve(preset, sampler, update, plan)
    editor = make_editor(chosen.editor.value, model=chosen.model, weights_dir=chosen.weights_dir)
    editor.check(instruction)
    features = _vgg(vgg)
    found = read(scene, drop_invalid=drop_invalid)
    dataset = load_views(data, found, size, up)

    journal = Journal(out / "metrics.jsonl")
    checkpoints = Checkpoints(
        out / "checkpoint.ply",
        "it is a whole scene, edited so far; add -f to run the edit again from the start",
    )
    with checkpoints:
        with narrator(as_json=common.json) as tell:
            steps = edit_steps(
                found,
                instruction,
                dataset=dataset,
                editor=editor,
                settings=settings,
                features=features,
                generator=common.generator(),
            )
            result = follow(steps, journal.telling(tell), checkpoints)
        request = {
            "instruction": instruction,
            "scene": scene,
            "data": data,
            "size": size,
            "editor": chosen,
            "preset": preset.value,
            "vgg": vgg,
            "seed": common.seed,
        }
        write_results(out, result, journal.events, request)
    explain_results(out, journal.events)
    record = {"folder": out, "scene": out / "scene.ply", "answer": result.answer}
    answer(record, str(out / "scene.ply"), as_json=common.json)


def resolve(
    preset: Preset, sampler: SamplerOptions, update: UpdateOptions, plan: RoundOptions
) -> EditSettings:
    """The preset's settings with what the user gave put over them. Raises UsageError."""
    from gsedit.diffusion import SamplerSettings
    from gsedit.edit import EditSettings
    from gsedit.strategies import UpdateSettings

    fitting = given(update)
    if "update_steps" in fitting:
        fitting["steps"] = fitting.pop("update_steps")
    return EditSettings(
        sampler=replace(SamplerSettings.preset(preset.value), **given(sampler)),
        update=UpdateSettings(**fitting),
        **given(plan),
    )


@dataclass
class Journal:
    """metrics.jsonl as it grows: every event is on disk before the next one happens."""

    path: Path
    events: list[Event] = field(default_factory=list)

    def telling(self, tell: Callable[[Event], None]) -> Callable[[Event], None]:
        """Write an event, then tell it."""

        def both(event: Event) -> None:
            self.write(event)
            tell(event)

        return both

    def write(self, event: Event) -> None:
        from gsedit.report import write_event

        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a" if self.events else "w", encoding="utf-8") as file:
            write_event(file, event)
        self.events.append(event)


def write_results(
    out: Path, result: EditResult, events: list[Event], request: dict[str, Any]
) -> None:
    """Every file of the folder, each whole or not at all; edit.json last, so that it seals them."""
    import json

    from gsedit.files import atomic_path, save
    from gsedit.show import contact_sheet, error_vs_time, save_picture

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
        "timings": result.timings,
        "gaussians": len(result.scene),
        "edited_views": [view.name for view in result.targets],
        "measured": {
            "matched": result.matched,
            "strength": result.strength,
            "residual": result.residual,
            "answer": result.answer,
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
        "versions": {name: version(name) for name in ("gsedit", "torch", "numpy")},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": torch.get_num_threads(),
    }


def explain_results(out: Path, events: list[Event]) -> None:
    from gsedit.report import table

    say(table(events))
    say(
        f"results are in {out}; look at {out / 'before_after.png'}, then: "
        f"gsedit preview {out / 'scene.ply'}"
    )


def _vgg(path: Path | None) -> Any:
    if path is None:
        return None
    from gsedit.features import Vgg16

    return Vgg16(path)


def load_views(data: Path | None, scene: Gaussians, size: int, up: str | None) -> Dataset:
    """The photos, or pictures of the scene from around it where there are none."""
    if data is not None:
        from gsedit.files import load_dataset

        return load_dataset(data, size=size)
    from gsedit.edit import ORBIT_VIEWS
    from gsedit.views import Dataset, capture

    cameras = around(scene, ORBIT_VIEWS, size, up)
    return Dataset(capture(scene, list(cameras.values()), list(cameras)))
