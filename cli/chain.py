"""Verbs that change a scene and write it again, chained in one command with `then`.

Such a verb is a function of its own options that returns the operation. SCENE, -o, -f, --dry-run
and the options of every command are added here; a verb whose function has a parameter of one of
these names (`output`, `files`) is given its value.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gsedit.errors import UsageError

from .core.checkpoints import NAME
from .core.command import LazyCommand, argument, keyword, parameters_of, verb_command, verb_name
from .core.console import print_result
from .core.current import current_scene
from .core.process import Output, process
from .options.common import FileOptions, first_scene

if TYPE_CHECKING:
    from gsedit.toolkit.operation import Operation

THEN = "then"
"""Word between two verbs of one command."""


def scene_or_checkpoint(path: Path) -> Path:
    """Return the current scene: SCENE, or the checkpoint in the folder of an interrupted edit."""
    checkpoint = path / NAME
    return first_scene(checkpoint if checkpoint.is_file() else path)


SceneOrCheckpoint = Annotated[
    Path,
    argument(
        "SCENE",
        "Scene file in any format, folder of an edit, or checkpoint.",
        callback=scene_or_checkpoint,
    ),
]


@dataclass(frozen=True)
class Target:
    """Output of a verb that names it without -o."""

    out: Path | None
    never_beside: str = ""
    """A file that must not lie in its folder."""


SHARED = {"output": Output, "files": FileOptions}
"""Option groups of all such verbs, by parameter name."""


@dataclass(frozen=True)
class Piece:
    """One verb of a command, with the values of its options."""

    verb: str
    operations: tuple[Operation, ...]
    output: Output
    files: FileOptions


def split(args: Iterable[str]) -> list[list[str]]:
    """Split the arguments of a command at each THEN."""
    pieces: list[list[str]] = [[]]
    for each in args:
        if each == THEN:
            pieces.append([])
        else:
            pieces[-1].append(each)
    return pieces


class OperationCommand(LazyCommand):
    """A verb that may be followed by `then` and another one."""

    def __init__(self, body: Callable[..., Any]) -> None:
        super().__init__(body, lambda: verb_command(body, self.run, [*FIRST, *self.parameters]))

    @property
    def parameters(self) -> list[inspect.Parameter]:
        """The verb's own parameters, then those of all such verbs."""
        own = [each for each in parameters_of(self.body) if each.name not in SHARED]
        return own + [keyword(name, kind) for name, kind in SHARED.items()]

    def make_context(self, name: str, args: list[str], *rest: Any, **options: Any) -> Any:
        """Return the context of the first verb, which holds the verbs behind `then`."""
        first, *others = split(args)
        context = super().make_context(name, first, *rest, **options)
        context.obj = (context.parent.command if context.parent else None, others)
        return context

    def run(self, ctx: typer.Context, scene: Path, **values: Any) -> None:
        """Run the whole chain that begins with this verb."""
        group, others = ctx.obj
        run_chain(scene, [self.piece(**values), *(parse_piece(group, args) for args in others)])

    def parse(self, args: list[str]) -> Piece:
        """Return the piece that this verb is in the middle of a command."""
        command = verb_command(self.body, self.piece, self.parameters)
        with command.make_context(self.name, args) as context:
            return command.invoke(context)

    def piece(self, **values: Any) -> Piece:
        """Return the piece that the values of the verb's options make."""
        asked, output = inspect.signature(self.body).parameters, values["output"]
        made = self.body(**{name: each for name, each in values.items() if name in asked})
        several = made if isinstance(made, list | tuple) else [made]
        operations = tuple(each for each in several if not isinstance(each, Target))
        for each in several:
            if isinstance(each, Target):
                output = replace(output, out=one_place(each, output.out))
        if any(each.moves for each in operations):
            current_scene.set(None)  # the cameras beside it do not fit it any more
        name = verb_name(self.body)
        return Piece(name, operations, output, values["files"])


FIRST = (keyword("ctx", typer.Context), keyword("scene", SceneOrCheckpoint))
"""Parameters of the first verb of a command."""


def one_place(target: Target, out: Path | None) -> Path | None:
    """Return the output, given as OUT or -o. Raises UsageError for both or a misleading place."""
    if target.out and out and target.out != out:
        raise UsageError(f"{target.out} and -o {out} are two scenes to write: name one of them")
    place = target.out or out
    if place and target.never_beside and place.with_name(target.never_beside).is_file():
        raise UsageError(
            f"{place} would lie beside {target.never_beside}, by which gsedit knows a scene that "
            "is still in the frame of its export: write it into another folder"
        )
    return place


def parse_piece(group: Any, args: list[str]) -> Piece:
    """Parse the verb behind a `then`. Raises UsageError for a name that is no such verb."""
    command = group.commands.get(args[0]) if args else None
    if not isinstance(command, OperationCommand):
        known = ", ".join(n for n, c in group.commands.items() if isinstance(c, OperationCommand))
        given = f"{THEN} {args[0]}" if args else f"nothing follows {THEN}"
        raise UsageError(f"{given}: name one of {known}")
    return command.parse(args[1:])


def run_chain(scene: Path, pieces: list[Piece]) -> None:
    """Run all operations in order and write the scene; with --dry-run only count."""
    outs = list(dict.fromkeys(str(p.output.out) for p in pieces if p.output.out))
    if len(outs) > 1:
        raise UsageError(f"one command writes one scene, not {' and '.join(outs)}: give one -o")
    output = _merged(Output, [p.output for p in pieces])
    files = _merged(FileOptions, [p.files for p in pieces])
    steps = [(p.verb, each) for p in pieces for each in p.operations]
    for i, (verb, each) in enumerate(steps):
        steps[i] = verb, each.at(scene)
        if not each.removes:
            break
    kept, written = process(scene, steps, output, files)
    record = {
        "scene": scene,
        "output": written,
        "gaussians": kept[-1][1].after,
        "steps": [{"verb": v, "before": k.before, "after": k.after} for v, k in kept[:-1]],
    }
    text = str(written) if written else "nothing was written (--dry-run)"
    print_result(record, text)


def _merged(kind: type, records: list[Any]) -> Any:
    """Merge the options of all pieces: each field has the last value that was given."""
    values = {}
    for field in fields(kind):
        given = [getattr(r, field.name) for r in records if getattr(r, field.name) != field.default]
        values[field.name] = given[-1] if given else field.default
    return kind(**values)
