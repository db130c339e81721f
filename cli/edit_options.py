"""What an edit can be told, in groups that mirror the library's settings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import given

if TYPE_CHECKING:
    from gsedit.editors import Editor
    from gsedit.session.settings import EditSettings
    from gsedit.strategies import Strategy


class Preset(str, Enum):
    default = "default"
    paper = "paper"


class SolverName(str, Enum):
    ddim = "ddim"
    euler = "euler"
    heun = "heun"
    multistep = "dpm++2m"
    ancestral = "ancestral"


class PrecisionName(str, Enum):
    float32 = "float32"
    bfloat16 = "bfloat16"
    auto = "auto"


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
        str,
        typer.Option(
            "--editor",
            metavar="NAME",
            rich_help_panel=EDITOR,
            help="small: learned, some fifty looks in your words; closed-form: 21 looks with a "
            "known answer, to measure by; pix2pix: InstructPix2Pix weights; command: any program; "
            "others: see gsedit editors.",
        ),
    ] = "small"
    model: Annotated[
        str | None,
        option(
            "--model",
            "pix2pix: a folder of weights, or a hub id. small: a file of weights.",
            rich_help_panel=EDITOR,
        ),
    ] = None
    weights_dir: Annotated[
        Path | None,
        option("--weights-dir", "pix2pix: where weights are kept.", rich_help_panel=EDITOR),
    ] = None
    run: Annotated[
        str | None,
        option(
            "--run",
            'command: the program, as in "my_editor {input} {output} {prompt}"; it must fill the '
            "folder {output} with a PNG for each in {input}. No shell is involved.",
            metavar="COMMAND",
            rich_help_panel=EDITOR,
        ),
    ] = None
    timeout: Annotated[
        float | None,
        option(
            "--timeout",
            "command: seconds that it may take for the views of a round (default: any).",
            metavar="SECONDS",
            rich_help_panel=EDITOR,
        ),
    ] = None

    def make(self, out: Path) -> Editor:
        """The editor, which may keep files below `out`. Raises UsageError."""
        from gsedit.editors import make_editor

        return make_editor(
            self.editor,
            model=self.model,
            weights_dir=self.weights_dir,
            run=self.run,
            timeout=self.timeout,
            folder=out / "command",
        )


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
            "--guidance",
            "How strongly the instruction (default: what suits the editor; 7.5, small 1.4)",
            rich_help_panel=SAMPLER,
        ),
    ] = None
    guidance_image: Annotated[
        float | None,
        option(
            "--image-guidance",
            "... and the picture hold (likewise; 1.5, small 1).",
            rich_help_panel=SAMPLER,
        ),
    ] = None
    temperature: Annotated[
        float | None,
        option(
            "--temperature",
            "How much of the starting noise: less is nearer to the middle of what is possible "
            "(likewise; 1, small 0.2).",
            rich_help_panel=SAMPLER,
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
    solver: Annotated[
        SolverName | None,
        option("--solver", "How a step is taken (default ddim).", rich_help_panel=SAMPLER),
    ] = None
    memory: Annotated[
        float | None,
        option(
            "--memory",
            "GB that a network may use for views at once (default: half of what is free).",
            metavar="GB",
            rich_help_panel=SAMPLER,
        ),
    ] = None
    precision: Annotated[
        PrecisionName | None,
        option(
            "--precision",
            "Of a network; auto: bfloat16 if the processor has it and it errs little (default).",
            rich_help_panel=SAMPLER,
        ),
    ] = None


@dataclass(frozen=True)
class UpdateOptions:
    """Fields of gsedit.fitting.update.UpdateSettings; None leaves the library's value."""

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


def resolve(
    preset: Preset,
    sampler: SamplerOptions,
    update: UpdateOptions,
    plan: RoundOptions,
    *,
    compile: bool = False,
) -> tuple[EditSettings, Strategy]:
    """The preset's settings with what the user gave put over them. Raises UsageError."""
    from gsedit.diffusion import SamplerSettings
    from gsedit.fitting.settings import UpdateSettings
    from gsedit.session.settings import EditSettings
    from gsedit.strategies.single_pass import SinglePass
    from rasterizer.numerics import Execution

    fitting = given(update)
    steps = fitting.pop("update_steps", None)
    settings = EditSettings(
        sampler=replace(SamplerSettings.preset(preset.value), **given(sampler)),
        update=UpdateSettings(**fitting),
        execution=Execution(compile=compile),
        **given(plan),
    )
    return settings, SinglePass() if steps is None else SinglePass(steps)
