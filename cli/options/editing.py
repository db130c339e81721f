"""Options of `gsedit edit`: the 2D editor's, the strategies', and those of the settings record."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from gsedit.errors import UsageError

from ..core.command import option
from ..core.console import print_message
from .settings import Layout, Setting, Values, choices_text, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.diffusion.settings import Precision
    from gsedit.editors import Editor
    from gsedit.paper.actions import Strategy
    from gsedit.paper.settings import EditSettings, Preset

EDITOR, STRATEGY, SAMPLING, UPDATE = "2D editor", "Strategy", "Sampling", "Scene update"
STEPS = {
    ("update", "patches"),
    ("update", "patch"),
    ("strategy", "update_steps"),
    ("strategy", "steps_between"),
}
"""Settings of steps on crops."""
LAYOUT = Layout(UPDATE, panels={"sampler": SAMPLING, "update": UPDATE, "execution": "Rendering"})

AUTO = "auto"
"""Name that leaves the choice of the editor to gsedit."""


@dataclass(frozen=True)
class EditorOptions:
    """Options of the 2D editor that follows the instruction."""

    editor: str = option(
        AUTO,
        "2D editor (see gsedit list editors). auto: tone, paint, materials, light and weather "
        "on the scene itself, small for the rest.",
        "NAME",
    )
    model: str | None = option(
        None,
        "pix2pix, diffusers: a folder of weights, or a Hugging Face id.",
    )
    weights_dir: Path | None = option(
        None, "pix2pix, diffusers: folder where downloaded weights are kept."
    )
    yes: bool = option(
        False, "pix2pix, diffusers: download what --model names without being asked."
    )
    runtime: str | None = option(
        None,
        "pix2pix, diffusers: who computes the networks. auto: openvino where it is installed, "
        "measured faster, and as exact; its networks are kept in the cache folder.",
        "torch|openvino|auto",
        show_default="auto",
    )
    run: str | None = option(
        None,
        'command: the program to run, as in "my_editor {input} {output} {prompt}". It must '
        "write to the folder {output} a PNG for each PNG in {input}. No shell is involved.",
        "COMMAND",
    )
    timeout: float | None = option(
        None,
        "command: seconds that the program may take for the views of a batch.",
        "SECONDS",
        show_default="no limit",
    )

    def settled(self) -> EditorOptions:
        """Return the options with the default editor where gsedit may choose one."""
        from gsedit.editors.registry import DEFAULT

        return replace(self, editor=DEFAULT) if self.editor == AUTO else self

    def make(self, out: Path, instruction: str | None, precision: Precision = "auto") -> Editor:
        """Make the editor, which may keep files below `out`.

        Raises UsageError for an option that it does not have, or an instruction that it cannot
        follow (None: it need not follow any).
        """
        from gsedit.editors import make_editor

        editor = make_editor(
            self.settled().editor,
            model=self.model,
            weights_dir=self.weights_dir,
            runtime=self.runtime,
            run=self.run,
            timeout=self.timeout,
            folder=out / "command",
            yes=self.yes or agreed,
            precision=precision,
        )
        if instruction is not None:
            editor.check(instruction)
        return editor


def agreed(offer: str) -> bool:
    """Ask on the terminal whether to download; no where there is none."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    return typer.confirm(f"{offer}. Download it?", err=True)


def at_size(settings: EditSettings, editor: Editor, size: int | None) -> EditSettings:
    """Return the settings with --size as the editor's too, where that was made for more.

    Prints a line then: an editor draws worse at a size that it was not trained at.
    """
    declared = editor.capabilities
    made_for = declared.best_size
    if size is None or settings.edit_size or not made_for or not declared.enlarges:
        return settings
    if size < made_for:
        print_message(
            f"--size {size}: this model was made for {made_for} pixels and draws worse below; "
            "leave --size out for its own, which takes longer"
        )
    return replace(settings, edit_size=min(size, made_for))


def edit_settings(own: Iterable[str] = ()) -> list[Setting]:
    """Return every option that comes from a field of EditSettings or of a strategy.

    `own`: the flags of the verb's other options. Raises TypeError as `strategy_options` does.
    """
    from gsedit.paper.settings import EditSettings
    from gsedit.paper.strategies import DEFAULT, find_strategy, strategy_names

    strategies = {name: find_strategy(name) for name in strategy_names()}
    choice = Setting(
        path=("strategy",),
        flag="--strategy",
        type=Literal[tuple(strategies)],
        meaning="When views are edited and when the scene is fitted to them "
        "(docs/concepts/strategies.md).",
        default=DEFAULT,
        panel=STRATEGY,
    )
    own = {*own, "--strategy"}
    shared = settings_of(EditSettings(), LAYOUT, taken=own)
    taken = {*own, *(setting.flag for setting in shared)}
    return [choice, *strategy_options(strategies, taken), *shared]


def strategy_options(strategies: dict[str, type[Strategy]], taken: Iterable[str]) -> list[Setting]:
    """Return an option for each field of any strategy; its help names the strategies with it.

    A field whose flag is `taken` gets the prefix `--strategy-`. Raises TypeError where strategies
    share a flag but not the field's name and type.
    """
    options: dict[str, Setting] = {}
    owners: dict[str, list[str]] = {}
    for name, strategy in strategies.items():
        for setting in settings_of(strategy(), Layout(STRATEGY), ("strategy",), taken):
            owners.setdefault(setting.flag, []).append(name)
            earlier = options.get(setting.flag, setting)
            check_same_field(earlier, setting, name)
            negatable = setting.negatable or earlier.negatable
            default = setting.default if setting.default == earlier.default else "by strategy"
            options[setting.flag] = replace(earlier, negatable=negatable, default=default)
    return [
        replace(setting, meaning=f"{setting.meaning} Of {', '.join(owners[setting.flag])}.")
        for setting in options.values()
    ]


def check_same_field(earlier: Setting, setting: Setting, name: str) -> None:
    """Raise TypeError unless two strategies, the later one `name`, mean the same by a flag."""
    if earlier.path != setting.path or earlier.type != setting.type:
        raise TypeError(
            f"{setting.flag} of the strategy {name} is {describe(setting)}, and "
            f"{describe(earlier)} of a strategy before it: give the field another name, or another "
            "flag in its metadata"
        )


def describe(setting: Setting) -> str:
    return f"{setting.path[-1]} ({choices_text(setting.type) or setting.type.__name__})"


def resolve(preset: str, values: Values, own: Iterable[str] = ()) -> tuple[EditSettings, Strategy]:
    """Return the settings and the strategy: values of the preset, replaced by given ones.

    `own`: the flags of the verb's other options, which decide those that an error message names.
    Raises UsageError for a value out of range, and an option that another strategy has.
    """
    from gsedit.paper.settings import find_preset

    shared = {path: value for path, value in values.items() if path[0] != "strategy"}
    chosen = {
        path[1:]: value for path, value in values.items() if path[0] == "strategy" and path[1:]
    }
    named = find_preset(preset)
    strategy = make_strategy(values.get(("strategy",)), chosen, own, named)
    return with_values(named.settings, shared), strategy


def idle_options(values: Values, settings: EditSettings, own: Iterable[str]) -> list[str]:
    """Return the flags that were given and do nothing, since colors are solved for at once."""
    from gsedit.paper.strategies import DEFAULT

    if not settings.solves or values.get(("strategy",), DEFAULT) != DEFAULT:
        return []
    return [each.flag for each in edit_settings(own) if each.path in STEPS & values.keys()]


def make_strategy(name: str | None, values: Values, own: Iterable[str], preset: Preset) -> Strategy:
    """Make the strategy of a name, or the default. Raises UsageError for a foreign option."""
    from gsedit.paper.strategies import DEFAULT, find_strategy, strategy_names

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
    return with_values(preset.applied_to(find_strategy(name)()), values)


def has_field(record: type, name: str) -> bool:
    return any(item.name == name for item in fields(record))
