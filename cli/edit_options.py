"""Options of `gsedit edit`: the 2D editor's, the strategies', and those of the settings record."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .setting_options import Layout, Setting, Values, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.editors import Editor
    from gsedit.session.settings import EditSettings
    from gsedit.strategies import Strategy

EDITOR, STRATEGY, SAMPLING, UPDATE = "2D editor", "Strategy", "Sampling", "Scene update"
LAYOUT = Layout(UPDATE, panels={"sampler": SAMPLING, "update": UPDATE, "execution": "Rendering"})


def editor_option(name: str, help: str, **more: Any) -> Any:
    return typer.Option(name, help=help, rich_help_panel=EDITOR, **{"show_default": False, **more})


@dataclass(frozen=True)
class EditorOptions:
    """Which 2D editor follows the instruction."""

    editor: Annotated[
        str,
        editor_option(
            "--editor",
            "The 2D editor that changes the views: small, pix2pix, closed-form, command, or one "
            "of another package; see gsedit editors.",
            metavar="NAME",
            show_default=True,
        ),
    ] = "small"
    model: Annotated[
        str | None,
        editor_option(
            "--model",
            "pix2pix: a folder of weights, or a Hugging Face id. small: a file of weights.",
        ),
    ] = None
    weights_dir: Annotated[
        Path | None,
        editor_option("--weights-dir", "pix2pix: folder where downloaded weights are kept."),
    ] = None
    run: Annotated[
        str | None,
        editor_option(
            "--run",
            'command: the program to run, as in "my_editor {input} {output} {prompt}". It must '
            "write to the folder {output} a PNG for each PNG in {input}. No shell is involved.",
            metavar="COMMAND",
        ),
    ] = None
    timeout: Annotated[
        float | None,
        editor_option(
            "--timeout",
            "command: seconds that the program may take for the views of a round.",
            metavar="SECONDS",
            show_default="no limit",
        ),
    ] = None

    guess: Annotated[
        bool,
        editor_option(
            "--guess",
            "small: follow an instruction that it does not understand with the nearest look that "
            "it knows, instead of refusing it.",
        ),
    ] = False

    def make(self, out: Path, instruction: str | None) -> Editor:
        """The editor, which may keep files below `out`. Raises UsageError for an option that it
        does not have, or an instruction that it cannot follow (None: it need not follow any).
        """
        from gsedit.editors import make_editor

        editor = make_editor(
            self.editor,
            model=self.model,
            weights_dir=self.weights_dir,
            run=self.run,
            timeout=self.timeout,
            folder=out / "command",
            guess=self.guess or None,
        )
        if instruction is not None:
            editor.check(instruction)
        return editor


def what_it_understood(editor: Editor, instruction: str) -> str:
    """For a person; empty for editors that take a sentence as it is."""
    understand = editor.capabilities.understand
    if understand is None:
        return ""
    understood = understand(instruction)
    return f"{'understood as' if understood.known else 'not understood, a guess'}: {understood}"


def edit_settings(own: Iterable[str] = ()) -> list[Setting]:
    """Every option that comes from a field of EditSettings or of a strategy.

    `own`: the flags of the verb's other options. Raises TypeError as `strategy_options` does.
    """
    from gsedit.session.settings import EditSettings
    from gsedit.strategies import DEFAULT, find_strategy, strategy_names

    strategies = {name: find_strategy(name) for name in strategy_names()}
    summaries = "; ".join(f"{name}: {summary(each)}" for name, each in strategies.items())
    choice = Setting(
        path=("strategy",),
        flag="--strategy",
        type=Enum("strategy", {name: name for name in strategies}, type=str),
        help=f"When views are edited and the scene is fitted. {summaries}. [default: {DEFAULT}]",
        panel=STRATEGY,
    )
    own = {*own, "--strategy"}
    shared = settings_of(EditSettings(), LAYOUT, taken=own)
    taken = {*own, *(setting.flag for setting in shared)}
    return [choice, *strategy_options(strategies, taken), *shared]


def summary(strategy: type) -> str:
    """The first line of a strategy's docstring."""
    return (strategy.__doc__ or "").strip().split("\n")[0].rstrip(".")


def strategy_options(strategies: dict[str, type[Strategy]], taken: Iterable[str]) -> list[Setting]:
    """An option for each field of any strategy, whose help names the strategies that have it.

    A field whose flag is `taken` gets the prefix `--strategy-`. Raises TypeError where strategies
    share a flag but not the field's name and type.
    """
    options: dict[str, Setting] = {}
    for name, strategy in strategies.items():
        for setting in settings_of(strategy(), Layout(STRATEGY), ("strategy",), taken):
            help = f"{name}: {setting.help}"
            negatable = setting.negatable
            if earlier := options.get(setting.flag):
                check_same_field(earlier, setting, name)
                help = f"{earlier.help} {help}"
                negatable = negatable or earlier.negatable
            options[setting.flag] = replace(setting, help=help, negatable=negatable)
    return list(options.values())


def check_same_field(earlier: Setting, setting: Setting, name: str) -> None:
    """Raise TypeError unless two strategies, the later one `name`, mean the same by a flag."""
    if earlier.path != setting.path or accepted(earlier.type) != accepted(setting.type):
        raise TypeError(
            f"{setting.flag} of the strategy {name} is {describe(setting)}, and "
            f"{describe(earlier)} of a strategy before it: give the field another name, or another "
            "flag in its metadata"
        )


def accepted(kind: type) -> Any:
    """What an option accepts: the values of an Enum, or the type itself."""
    return [choice.value for choice in kind] if issubclass(kind, Enum) else kind


def describe(setting: Setting) -> str:
    return f"{setting.path[-1]} ({setting.type.__name__})"


def resolve(preset: str, values: Values, own: Iterable[str] = ()) -> tuple[EditSettings, Strategy]:
    """The settings and the strategy: the preset's values, replaced by those that were given.

    `own`: the flags of the verb's other options, which decide those that an error message names.
    Raises UsageError for a value out of range, and an option that another strategy has.
    """
    from gsedit.diffusion import SamplerSettings
    from gsedit.session.settings import EditSettings

    shared = {path: value for path, value in values.items() if path[0] != "strategy"}
    chosen = {
        path[1:]: value for path, value in values.items() if path[0] == "strategy" and path[1:]
    }
    settings = EditSettings(sampler=SamplerSettings.preset(preset))
    return with_values(settings, shared), make_strategy(values.get(("strategy",)), chosen, own)


def make_strategy(name: str | None, values: Values, own: Iterable[str]) -> Strategy:
    """The strategy of that name, or the default. Raises UsageError for an option it has not."""
    from gsedit.errors import UsageError
    from gsedit.strategies import DEFAULT, find_strategy, strategy_names

    name = name or DEFAULT
    for path in values:
        owners = [each for each in strategy_names() if has_field(find_strategy(each), path[0])]
        if name not in owners:
            flag = next(
                each.flag for each in edit_settings(own) if each.path == ("strategy", *path)
            )
            raise UsageError(
                f"{flag} is an option of the strategy {' and '.join(owners)}, not of {name}: "
                f"leave it out, or add --strategy {owners[0]}"
            )
    return with_values(find_strategy(name)(), values)


def has_field(record: type, name: str) -> bool:
    return any(item.name == name for item in fields(record))
