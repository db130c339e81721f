"""Turn a verb's function into a command of the program.

An option is a field of a record: type, choices and default are the field's, and the docstring under
it is the help. A field whose metadata holds a flag, as `{"flag": "--views"}`, has that flag; any
other is given by `--set NAME=VALUE` alone, where NAME is its path, as in `sampler.solver`. The help
of a verb lists the options that most users need, and `--help-all` all that have a flag.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import typer
from typer.core import TyperCommand

from gsedit.errors import UsageError

from .console import as_json
from .current import with_saved_regions

if TYPE_CHECKING:
    import torch

Body = Callable[..., Any]
Record = TypeVar("Record")
FieldPath = tuple[str, ...]
"""Names of fields from the outermost record inwards: ("sampler", "steps")."""
Values = Mapping[FieldPath, Any]

SIMPLE = (int, float, str, bool, Path)
SHOWN_OPTIONS = "shown_options"
"""Attribute of a verb's function that holds the flags its help lists."""
SET = "--set."
"""Beginning of the name, known to the parser alone, of an option that has no flag."""
HELP_FLAGS = frozenset({"--set", "--help", "--help-all"})
RARE = frozenset({"--debug", "--threads", "--drop-invalid", "--spz-frame", "--samples"})
"""Flags that the help of a verb leaves out unless the verb names its own list."""
METAVARS = {int: "N", float: "X", str: "TEXT", Path: "PATH"}
"""Texts for values in a help, by their types."""
SWITCHES = {"on": True, "true": True, "yes": True, "1": True}
SWITCHES |= {"off": False, "false": False, "no": False, "0": False}
"""Values of a flag in `--set`."""


def option(
    default: Any = None, metavar: str | None = None, *, flags: str | None = "", **more: Any
) -> Any:
    """Make a field of a verb's record that is an option, with the text for its value.

    The flag is the field's name unless `flags` names others, separated by spaces; None: no flag.
    `more` goes to typer.Option: min, max, callback, ...
    """
    own = {} if flags is None else {"flag": flags}
    return field(default=default, metadata={**own, "option": {"metavar": metavar, **more}})


@dataclass(frozen=True)
class Common:
    """Options of every verb."""

    json: bool = option(False)
    """Print results and events as JSON lines on stdout."""
    debug: bool = option(False)
    """Show the traceback of an error."""
    threads: int | None = option(None, min=1, max=1024)  # each takes memory
    """CPU threads to use. None: torch's choice."""

    def apply(self) -> None:
        """Set how results are printed, and the number of threads, of torch and of programs that are
        started, for good."""
        if self.json:
            as_json.set(True)
        if self.threads:
            import torch

            os.environ["OMP_NUM_THREADS"] = str(self.threads)
            torch.set_num_threads(self.threads)


@dataclass(frozen=True)
class Seeded(Common):
    """Options of every verb that draws random numbers."""

    seed: int = option(0, min=0, max=(1 << 32) - 1)  # torch and numpy take it
    """Seed of the random numbers. Equal seeds and threads give equal results."""

    def generator(self) -> torch.Generator:
        """The only source of random numbers of a command."""
        import torch

        return torch.Generator().manual_seed(self.seed)


def argument(metavar: str, help: str, **more: Any) -> Any:
    """Make the typer.Argument of a parameter."""
    return typer.Argument(metavar=metavar, help=help, show_default=False, **more)


@dataclass(frozen=True)
class Setting:
    """A field of a record as an option."""

    path: FieldPath
    flags: tuple[str, ...]
    """None for an option of `--set` alone."""
    type: Any
    """One of SIMPLE, a list of one, or a Literal of the choices."""
    meaning: str
    default: str
    """Text of the default value; empty where there is none to show."""
    negatable: bool = False
    """Whether --no-... exists beside the flag."""
    required: bool = False
    more: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of typer.Option."""

    @property
    def name(self) -> str:
        """The parameter's name in the verb's function."""
        return "__".join(self.path)

    def parameter(self) -> inspect.Parameter:
        """Return the option as typer reads it; None where it is not given."""
        first, *others = self.flags or (f"{SET}{'.'.join(self.path)}",)
        if self.negatable:
            first = f"{first}/--no-{first.removeprefix('--')}"
        shown = f"{self.meaning}  [default: {self.default}]" if self.default else self.meaning
        is_choice = get_origin(self.type) is Literal
        text = "|".join(get_args(self.type)) if is_choice else METAVARS.get(self.type)
        more = {"metavar": text, "show_default": False}
        given = {name: value for name, value in self.more.items() if value is not None}
        found = typer.Option(first, *others, help=shown, **{**more, **given})
        if self.required:
            return keyword(self.name, Annotated[self.type, found])
        return keyword(self.name, Annotated[self.type | None, found], None)


class Settings:
    """The options of settings as one parameter of a verb: `Values` of those that are given."""

    def __init__(self, settings: Callable[[], Iterable[Setting]]) -> None:
        self.settings = settings
        """Called when the verb is asked for: it imports the record."""


def settings_of(
    record: Any, parents: FieldPath = (), without: Iterable[str] = ()
) -> Iterator[Setting]:
    """Yield the options of a record, or of a class of records; those of records in it too.

    Raises TypeError for a field whose type no option can hold.
    """
    kind = record if isinstance(record, type) else type(record)
    types, docs = get_type_hints(kind), field_docs(kind)
    for item in fields(record):
        path = (*parents, item.name)
        default = item.default if record is kind else getattr(record, item.name)
        if item.name in without:
            continue
        if is_dataclass(default):
            yield from settings_of(default, path)
            continue
        flag = item.metadata.get("flag")
        flags = () if flag is None else (flag or f"--{item.name.replace('_', '-')}").split()
        yield Setting(
            path, tuple(flags), option_type(path, types[item.name]),
            *meaning_and_default(docs.get(item.name, item.name), default),
            negatable=default is True, required=default is MISSING or default is ...,
            more=item.metadata.get("option", {}),
        )  # fmt: skip


def option_type(path: FieldPath, annotation: Any) -> Any:
    """Return the type of a field's option: the field's own, without None.

    Raises TypeError for a type that no option can hold.
    """
    alternatives = [item for item in get_args(annotation) if item is not type(None)]
    if get_origin(annotation) is Literal or annotation in SIMPLE:
        return annotation
    if get_origin(annotation) is list and alternatives[0] in SIMPLE:
        return annotation
    if len(alternatives) == 1 and type(None) in get_args(annotation):
        return option_type(path, alternatives[0])
    raise TypeError(f"setting {'.'.join(path)}: no option can hold a {annotation}")


def meaning_and_default(doc: str, default: Any) -> tuple[str, str]:
    """Split the docstring of a field into its meaning and the text of its default value.

    A docstring may end with "None: ..." to say what None means, which is then the default's text.
    """
    text, *rest = re.split(r"(?:^|\s)None: ", " ".join(doc.replace("`", "").split()))
    match default:
        case None:
            shown = rest[0].rstrip(".") if rest else ""
        case bool():
            shown = "on" if default else ""
        case float():
            shown = f"{default:.3g}"
        case _:
            shown = "" if default is MISSING or default is ... else str(default)
    return f"{text.rstrip(' .;')}.", shown


@lru_cache
def classes_of(module: str) -> dict[str, ast.ClassDef]:
    """Return the classes that a module defines, by name; none without source code."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


@lru_cache
def field_docs(record: type) -> dict[str, str]:
    """Return the docstring under each field of a dataclass and its bases; none without source."""
    docs: dict[str, str] = {}
    for base in reversed(record.__mro__[:-1]):
        definition = classes_of(base.__module__).get(base.__name__)
        body = [] if definition is None else definition.body
        for statement, after in pairwise(body):
            match statement, after:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(doc))),
                ):
                    docs[name] = doc
    return docs


def with_values(record: Record, values: Values) -> Record:
    """Return the record with the given values for its own. Raises UsageError for a bad value."""
    own = {path[0]: value for path, value in values.items() if len(path) == 1}
    nested: dict[str, dict[FieldPath, Any]] = {}
    for (head, *tail), value in values.items():
        if tail:
            nested.setdefault(head, {})[tuple(tail)] = value
    inner = {name: with_values(getattr(record, name), each) for name, each in nested.items()}
    try:
        return replace(cast(Any, record), **own, **inner)
    except ValueError as error:  # of records that do not know gsedit's errors
        raise UsageError(str(error)) from error


def keyword(
    name: str, annotation: Any, default: Any = inspect.Parameter.empty
) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, annotation=annotation, default=default)


def shows(*flags: str) -> Callable[[Body], Body]:
    """Name the options that the help of a verb lists; `--help-all` lists the others too."""

    def mark(body: Body) -> Body:
        setattr(body, SHOWN_OPTIONS, {*flags, *HELP_FLAGS})
        return body

    return mark


def parameters_of(body: Body) -> list[inspect.Parameter]:
    """Return the parameters of a verb's function, with their types instead of the types' names."""
    # not signature(eval_str=True): what a verb returns may be imported for type checkers alone
    own = inspect.signature(body).parameters.values()
    return [each.replace(annotation=eval(each.annotation, body.__globals__)) for each in own]


def members_of(kind: Any) -> list[Setting]:
    """Return the options that a parameter of this type stands for; none for a single option."""
    if is_dataclass(kind):
        return list(settings_of(kind))
    found = [item for item in get_args(kind) if isinstance(item, Settings)]
    return list(found[0].settings()) if found else []


def as_command(body: Body, parameters: Iterable[inspect.Parameter], run: Body) -> Body:
    """Make the function that typer reads of a verb: a parameter that is a record, or annotated as
    `Settings`, becomes single options, and those of every verb are added. `run` takes the
    parameters."""
    parameters, own = list(parameters), "common_"
    kinds = [each.annotation for each in parameters if isinstance(each.annotation, type)]
    if not any(issubclass(kind, Common) for kind in kinds):
        parameters.append(keyword(own, Common))
    options: list[inspect.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], list[Setting]]] = {}
    for parameter in parameters:
        if members := members_of(kind := parameter.annotation):
            groups[parameter.name] = cast(type, kind) if is_dataclass(kind) else dict, members
            options += [member.parameter() for member in members]
        else:
            options.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    options += [keyword("set_", SetOption, None), keyword("help_all", HelpAll, False)]

    def command(**values: Any) -> Any:
        del values["set_"], values["help_all"]  # VerbCommand has treated them
        values = with_saved_regions(values)
        gathered = {}
        for name, (make, members) in groups.items():
            given = {each.path: values.pop(each.name) for each in members}
            given = {path: value for path, value in given.items() if value is not None}
            if make is dict:
                gathered[name] = given
                continue
            gathered[name] = made = make(**{path[0]: value for path, value in given.items()})
            if isinstance(made, Common):
                made.apply()
        gathered.pop(own, None)
        return run(**values, **gathered)

    command.__name__, command.__doc__ = body.__name__, body.__doc__
    command.__signature__ = inspect.Signature(options)  # pyright: ignore[reportFunctionMemberAccess]
    command.__annotations__ = {option.name: option.annotation for option in options}
    return command


class VerbCommand(TyperCommand):
    """A verb that understands `--set`, and lists some of its options or all."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, with each `--set` replaced by the option that it names."""
        try:
            return super().parse_args(ctx, list(expand_set(self.params, args)))
        except typer.BadParameter as error:
            error.ctx = error.ctx or ctx  # names the verb in the message
            raise

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the arguments without the braces and dots that typer puts around them."""
        pieces = super().collect_usage_pieces(ctx)
        return [re.sub(r"[{}]|\.{3}(?=\.{3})", "", piece) for piece in pieces]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments and options that are not hidden."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            if record := param.get_help_record(ctx):
                is_option = param.opts[0].startswith("-")
                name = record[0] if is_option else record[0].partition(" ")[0]
                text = record[1].replace("]  [", "; ")
                sections["Options" if is_option else "Arguments"].append((name, text))
        sections["Options"].sort(key=lambda row: not row[0].startswith("-o"))
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records, col_max=24)


def expand_set(params: Iterable[Any], args: Iterable[str]) -> Iterator[str]:
    """Yield the arguments, each `--set NAME=VALUE` as the option that it names.

    NAME is a flag without its dashes, or the path of a setting, such as `sampler.steps`. Raises
    typer.BadParameter for a name that no option has, with the nearest one.
    """
    rest = iter(args)
    for each in rest:
        flag, equals, text = each.partition("=")
        if flag != "--set":
            yield each
            continue
        text = text if equals else next(rest, "")
        name, equals, value = text.partition("=")
        if not equals:
            raise typer.BadParameter(f"--set {text}: give NAME=VALUE, as in --set seed=1")
        option = find_option(params, name)
        if not option.is_flag:
            yield f"{option.opts[0]}={value}"
        elif value.lower() not in SWITCHES:
            raise typer.BadParameter(f"--set {text}: give on or off")
        elif SWITCHES[value.lower()]:
            yield option.opts[0]
        else:
            yield from option.secondary_opts[:1]


def find_option(params: Iterable[Any], name: str) -> Any:
    """Return the option of a name, or of the last part of its path where no other option has it."""
    known = {}
    for param in params:
        if param.opts[0].startswith("--") and not HELP_FLAGS & {*param.opts}:
            known[param.name.replace("__", ".")] = param
            if not param.opts[0].startswith(SET):
                known.setdefault(param.opts[0].removeprefix("--").replace("-", "_"), param)
    wanted = name.strip().removeprefix("--").replace("-", "_")
    if wanted in known:
        return known[wanted]
    ends = {path: param for path, param in known.items() if path.rpartition(".")[2] == wanted}
    if len({id(param) for param in ends.values()}) == 1:
        return next(iter(ends.values()))
    close = list(ends) or get_close_matches(wanted, known, 1)
    move = f"did you mean {' or '.join(close)}?" if close else "gsedit list settings lists them"
    raise typer.BadParameter(f"--set {name}: no option has this name; {move}")


class LazyCommand(TyperCommand):
    """A verb that is listed at once, and whose options are made when it is asked for.

    Options that are derived from settings import the records of those settings.
    """

    def __init__(self, body: Body, make: Callable[[], Any] | None = None) -> None:
        super().__init__(verb_name(body), help=(body.__doc__ or "").partition("\n\n")[0])
        self.body = body
        self.make = make or (lambda: verb_command(body))
        """Returns the whole command."""

    @property
    def parameters(self) -> list[inspect.Parameter]:
        """Return the parameters of the verb, groups of options among them."""
        return parameters_of(self.body)

    def settings(self) -> Iterator[Setting]:
        """Yield the verb's settings, and its other options that have no flag."""
        for parameter in self.parameters:
            is_own = is_dataclass(parameter.annotation)
            for each in members_of(parameter.annotation):
                if not (is_own and each.flags):
                    yield each

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Return the context of the whole command, which then replaces this one."""
        return self.make().make_context(*args, **options)


def verb_name(body: Body) -> str:
    """Return the name of a verb as it is typed: `filter` for the function `filter_`."""
    return body.__name__.strip("_").replace("_", "-")


def verb_command(
    body: Body, run: Body | None = None, parameters: Iterable[inspect.Parameter] | None = None
) -> Any:
    """Make the whole command of a verb's function; `run` is called instead, with `parameters`."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    function = as_command(body, parameters or parameters_of(body), run or body)
    app.command(verb_name(body), cls=VerbCommand)(function)
    command = typer.main.get_command(app)
    shown = getattr(body, SHOWN_OPTIONS, None)
    for param in command.params:
        flags = {each for each in param.opts if each.startswith("-")}
        if flags:
            rare = flags.isdisjoint(shown) if shown else not flags.isdisjoint(RARE)
            is_set = param.opts[0].startswith(SET)
            setattr(param, "hidden", rare or is_set)  # noqa: B010  # an option has it
    return command


def show_all(ctx: Any, requested: bool) -> None:
    """Print the help with all options that have a flag, and end the command."""
    if requested:
        for param in ctx.command.params:
            param.hidden = param.opts[0].startswith(SET)
        typer.echo(ctx.get_help())
        raise typer.Exit


SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        show_default=False,
        help="Set any option by its name; repeatable.",
    ),
]
HelpAll = Annotated[
    bool, typer.Option("--help-all", is_eager=True, callback=show_all, help="List all options.")
]
