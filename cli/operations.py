"""Verbs that change a scene and write it again: one after another in one command, with `then`.

Such a verb is a function of its own options that returns the operation. SCENE, -o, -f, --dry-run
and the options of every command are added here; a verb whose function has a parameter of one of
these names (`output`, `files`, `common`) is given its value.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .command import LazyCommand, as_command, paragraphs
from .console import print_message, print_result
from .file_options import FileOptions
from .options import Common, DropInvalid, Force, Scene, check_file, current_scene, output

if TYPE_CHECKING:
    from gsedit.files.streams import Blocks, SceneHeader, SceneSource
    from gsedit.files.validity import Guard
    from gsedit.points.operation import Kept, Operation

THEN = "then"
"""Stands between two verbs of one command."""


@dataclass(frozen=True)
class Output:
    """Where the scene goes."""

    out: Annotated[
        Path | None, output("Scene to write; its suffix is the format. Not needed by --dry-run.")
    ] = None
    force: Force = False
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be kept; write nothing.")
    ] = False
    drop_invalid: DropInvalid = False


@dataclass(frozen=True)
class Target:
    """What a verb returns that changes nothing: where the scene goes, as if by -o."""

    out: Path | None
    never_beside: str = ""
    """A file that must not lie in its folder."""


SHARED = {"output": Output, "files": FileOptions, "common": Common}
"""The options of all such verbs, by the names of parameters."""


@dataclass(frozen=True)
class Piece:
    """One verb of a command, as its options were given."""

    verb: str
    operations: tuple[Operation, ...]
    output: Output
    files: FileOptions
    common: Common


def operation_verb(body: Callable[..., Any]) -> OperationCommand:
    """The verb of a function that returns an operation, or several, from its own options."""
    return OperationCommand(body)


class OperationCommand(LazyCommand):
    """A verb that may be followed by `then` and another one."""

    def __init__(self, body: Callable[..., Any]) -> None:
        name = verb_name(body)
        super().__init__(
            name, paragraphs(body).split("\n")[0], lambda: self.typer_app(as_first(body))
        )
        self.body = body

    def typer_app(self, function: Callable[..., Any]) -> typer.Typer:
        app = typer.Typer(add_completion=False)
        app.command(self.name)(as_command(function))
        return app

    def make_context(self, name: str, args: list[str], *rest: Any, **options: Any) -> Any:
        """The context of the first verb; what follows `then` waits in it for `run_chain`."""
        first, *others = split(args)
        context = super().make_context(name, first, *rest, **options)
        context.obj = (context.parent.command if context.parent else None, others)
        return context

    def parse(self, args: list[str]) -> Piece:
        """The piece that this verb is in the middle of a command."""
        command = typer.main.get_command(self.typer_app(as_later(self.body)))
        with command.make_context(self.name, args) as context:
            return command.invoke(context)


def verb_name(body: Callable[..., Any]) -> str:
    """`reduce_sh` is typed as `reduce-sh`, `filter_` as `filter`."""
    return body.__name__.strip("_").replace("_", "-")


def split(args: Iterable[str]) -> list[list[str]]:
    """The arguments between the words `then`."""
    pieces: list[list[str]] = [[]]
    for each in args:
        if each == THEN:
            pieces.append([])
        else:
            pieces[-1].append(each)
    return pieces


def as_first(body: Callable[..., Any]) -> Callable[..., None]:
    """The verb with SCENE in front, which runs the whole command."""

    def verb(
        ctx: typer.Context,
        scene: Path,
        output: Output,
        files: FileOptions,
        common: Common,
        **values: Any,
    ) -> None:
        group, others = ctx.obj
        piece = as_piece(body, output, files, common, values)
        run_chain(scene, [piece, *(parse_piece(group, args) for args in others)])

    return _with_parameters(verb, body, ("ctx", typer.Context), ("scene", Scene))


def as_later(body: Callable[..., Any]) -> Callable[..., Piece]:
    """The verb as it stands behind `then`."""

    def verb(output: Output, files: FileOptions, common: Common, **values: Any) -> Piece:
        return as_piece(body, output, files, common, values)

    return _with_parameters(verb, body)


def as_piece(
    body: Callable[..., Any],
    output: Output,
    files: FileOptions,
    common: Common,
    values: dict[str, Any],
) -> Piece:
    shared = {"output": output, "files": files, "common": common}
    asked = inspect.signature(body).parameters
    made = body(**values, **{name: each for name, each in shared.items() if name in asked})
    several = made if isinstance(made, list | tuple) else [made]
    operations = tuple(each for each in several if not isinstance(each, Target))
    for each in several:
        if isinstance(each, Target):
            output = replace(output, out=one_place(each, output.out))
    if any(each.moves for each in operations):
        current_scene.set(None)  # the cameras beside it do not fit it any more
    return Piece(verb_name(body), operations, output, files, common)


def one_place(target: Target, out: Path | None) -> Path | None:
    """Where the scene goes, as OUT or as -o. Raises UsageError for both or a misleading place."""
    from gsedit.errors import UsageError

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
    """The verb behind a `then`, by its name among all verbs. Raises UsageError."""
    from gsedit.errors import UsageError

    command = group.commands.get(args[0]) if args else None
    if not isinstance(command, OperationCommand):
        known = ", ".join(n for n, c in group.commands.items() if isinstance(c, OperationCommand))
        given = f"{THEN} {args[0]}" if args else f"nothing follows {THEN}"
        raise UsageError(f"{given}: name one of {known}")
    return command.parse(args[1:])


def run_chain(scene: Path, pieces: list[Piece]) -> None:
    """Do all operations in order and write the scene, or with --dry-run only count."""
    from gsedit.errors import UsageError

    outs = list(dict.fromkeys(str(p.output.out) for p in pieces if p.output.out))
    if len(outs) > 1:
        raise UsageError(f"one command writes one scene, not {' and '.join(outs)}: give one -o")
    output = _merged(Output, [p.output for p in pieces])
    files = _merged(FileOptions, [p.files for p in pieces])
    common = _merged(Common, [p.common for p in pieces])
    common.apply()
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
    print_result(record, text, as_json=common.json)


def process(
    path: Path, steps: list[tuple[str, Operation]], output: Output, files: FileOptions
) -> tuple[list[tuple[str, Kept]], Path | None]:
    """Read, change and write a scene a part at a time; the counts of each step, then of all."""
    from gsedit.errors import UsageError
    from gsedit.files.formats import open_scene, writable_format, write_scene
    from gsedit.files.validity import Guard
    from gsedit.points.operation import Kept, run

    if output.out is None and not output.dry_run:
        raise UsageError("name the scene to write with -o, or add --dry-run")
    if output.out is not None:
        writable_format(output.out)
        check_file(output.out, output.force or output.dry_run)
    source = open_scene(path, files.read())
    write_companions = companions(path, output, [each for _, each in steps])
    for note in source.notes:
        print_message(f"{path}: {note}")
    dropped = Guard(drop=True) if output.drop_invalid else None
    last, total = Guard(drop=False, of="the result"), Kept(before=source.count)
    blocks = dropped(source.blocks()) if dropped else source.blocks()
    header, blocks, counts = run(
        source.header, blocks, [each for _, each in steps], partial(_say, path)
    )
    header, blocks = fitted(header, blocks, output.out)
    blocks = _checked(last(blocks), dropped, last, source, total)
    if output.dry_run or output.out is None:
        for _ in blocks:
            pass
    else:
        write_scene(
            output.out, header, blocks, options=files.write(output.out), overwrite=output.force
        )
    write_companions()
    if dropped and dropped.invalid:
        print_message(f"{path}: rows left out by --drop-invalid: {dropped.invalid:,}")
    named = [(verb, kept) for (verb, _), (_, kept) in zip(steps, counts)]
    for verb, kept in ((v, k) for (v, o), (_, k) in zip(steps, counts) if o.removes):
        print_message(f"{verb}: {kept}")
    return [*named, ("all", total)], None if output.dry_run else output.out


def companions(path: Path, output: Output, operations: list[Operation]) -> Callable[[], None]:
    """What writes the files that go with the scene: its moved cameras (--cameras), and the
    similarities that were found (--save). Raises UsageError now if one cannot be written."""
    saving = [each for each in operations if getattr(each, "save", None)]
    for each in saving:
        check_file(each.save, output.force or output.dry_run)  # pyright: ignore[reportAttributeAccessIssue]
    cameras = None
    if any(getattr(each, "cameras", False) for each in operations):
        from gsedit.points.camera_moves import CameraMove

        cameras = CameraMove(path, None if output.dry_run else output.out, output.force)

    def write() -> None:
        if output.dry_run:
            return
        for each in saving:
            from gsedit.files.similarity_files import write_similarity

            write_similarity(each.moved, each.save, overwrite=output.force)  # pyright: ignore[reportAttributeAccessIssue]
            print_message(f"the similarity: {each.save}")  # pyright: ignore[reportAttributeAccessIssue]
        if cameras and (file := cameras.write(operations)):
            print_message(f"cameras moved along: {file}")

    return write


def fitted(header: SceneHeader, blocks: Blocks, out: Path | None) -> tuple[SceneHeader, Blocks]:
    """The scene as the format can hold it: what is left out is told, and too much SH is cut."""
    if out is None:
        return header, blocks
    from gsedit.files.formats import lost, writable_format
    from gsedit.points.operation import run
    from gsedit.points.reduce_sh import ReduceSH

    format = writable_format(out)
    for sentence in lost(header, format):
        print_message(f"{out}: {sentence}")
    if header.degree <= format.max_degree:
        return header, blocks
    return run(header, blocks, [ReduceSH(format.max_degree)], partial(_say, out))[:2]


def _checked(
    blocks: Any, dropped: Guard | None, last: Guard, source: SceneSource, total: Kept
) -> Any:
    """The blocks, counted; then an error for invalid rows, before the file gets its name.

    `dropped` left out those of the file; `last` has seen the result.
    """
    from gsedit.errors import UsageError
    from gsedit.files.validity import Guard

    for block in blocks:
        total.after += len(block)
        yield block
    if dropped is not None:
        dropped.check(source.path)
    if not last.invalid:
        return
    if dropped is None:
        # a row of the file is named by its place there, which operations may have changed
        file = Guard(drop=False)
        for _ in file(source.blocks()):
            pass
        file.check(source.path)
    raise UsageError(
        f"{source.path}: {last.invalid:,} of {last.rows:,} rows became invalid on the way, "
        f"the first is {last.first}: give the operations smaller numbers"
    )


def _say(path: Path, text: str) -> None:
    print_message(f"{path}: {text}")


def _merged(kind: type, records: list[Any]) -> Any:
    """One record of all pieces' options: of each field the last value that was given."""
    values = {}
    for field in fields(kind):
        given = [getattr(r, field.name) for r in records if getattr(r, field.name) != field.default]
        values[field.name] = given[-1] if given else field.default
    return kind(**values)


def _with_parameters(
    verb: Callable[..., Any], body: Callable[..., Any], *first: tuple[str, Any]
) -> Callable[..., Any]:
    """`verb` with the signature of `body` between `first` and the options of all such verbs."""
    kind = inspect.Parameter.KEYWORD_ONLY
    leading = [inspect.Parameter(name, kind, annotation=a) for name, a in first]
    own = [
        # evaluated here: the operation that the body returns is not imported yet
        each.replace(kind=kind, annotation=eval(each.annotation, body.__globals__))
        for each in inspect.signature(body).parameters.values()
        if each.name not in SHARED
    ]
    shared = [inspect.Parameter(name, kind, annotation=a) for name, a in SHARED.items()]
    verb.__signature__ = inspect.Signature([*leading, *own, *shared])  # pyright: ignore[reportFunctionMemberAccess]
    verb.__name__, verb.__doc__ = body.__name__, body.__doc__
    return verb
