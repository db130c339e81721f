"""Turn a verb's function into a command of the program.

Groups of options are spread into single options. The help of a verb lists the options that most
users need; `--help-all` lists all of them, and `--set NAME=VALUE` gives any of them a value.
"""

from __future__ import annotations

import inspect
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import Field, field, fields, is_dataclass
from difflib import get_close_matches
from typing import Annotated, Any, Protocol, get_args, get_origin, get_type_hints, runtime_checkable

import typer
from typer.core import TyperCommand
from typer.models import OptionInfo

from .current import with_saved_regions

Body = Callable[..., Any]
SHOWN_OPTIONS = "shown_options"
"""Attribute of a verb's function that holds the flags its help lists."""
HELP_FLAGS = frozenset({"--set", "--help", "--help-all"})
RARE = frozenset(
    {"--debug", "--threads", "--drop-invalid", "--spz-frame", "--spz-version", "--samples"}
)
"""Flags that the help of a verb leaves out unless the verb names its own list."""
COLUMN_WIDTH = 24
"""Widest column of flags in a help, characters."""
METAVARS = {"bool": "", "int": " N", "float": " X", "str": " TEXT", "path": " PATH"}
"""Texts for values in a help, by the type that typer names."""
VALUE_TYPE = re.compile(r" <(bool|int|float|str|path)( range)?>$")
DEFAULT_IN_BRACKETS = re.compile(r"\[default: \((.*?)\)(?=[;\]])")
HELP_ALL = object()
"""Marks the context of `--help-all`."""
SWITCHES = {"on": True, "true": True, "yes": True, "1": True}
SWITCHES |= {"off": False, "false": False, "no": False, "0": False}
"""Values of a flag in `--set`."""


@runtime_checkable
class OptionGroup(Protocol):
    """Options that a verb receives as one value: metadata of its parameter's `Annotated`."""

    def parameters(self) -> list[inspect.Parameter]:
        """The single options, each a keyword-only parameter as typer reads them."""
        ...

    def gather(self, values: dict[str, Any]) -> Any:
        """The verb's value, from the values of the options by parameter name."""
        ...


def option(
    default: Any, help: str, metavar: str | None = None, *, flags: str = "", **more: Any
) -> Any:
    """Make a dataclass field that is an option: its help, and the text for its value.

    The flag is the field's name unless `flags` names others, separated by spaces. `more` goes to
    typer.Option: min, max, show_default, ...
    """
    given = {"help": help, "metavar": metavar, "flags": flags.split(), **more}
    return field(default=default, metadata={"option": given})


def output(default: Any, help: str) -> Any:
    """Make the dataclass field of the -o option; the default ... makes it required."""
    return option(default, help, "PATH", flags="--output -o")


def flag(flags: str, help: str, metavar: str | None = None, **more: Any) -> Any:
    """Make the typer.Option of a parameter; `flags` are separated by spaces."""
    return typer.Option(*flags.split(), help=help, metavar=metavar, **more)


def argument(metavar: str, help: str, **more: Any) -> Any:
    """Make the typer.Argument of a parameter."""
    return typer.Argument(metavar=metavar, help=help, show_default=False, **more)


class DataclassGroup:
    """The fields of a dataclass as options; its attribute `panel` is their heading."""

    def __init__(self, record: type) -> None:
        self.record = record

    def parameters(self) -> list[inspect.Parameter]:
        types = get_type_hints(self.record, include_extras=True)
        return [
            keyword(each.name, self.annotation(each, types[each.name]), each.default)
            for each in fields(self.record)
        ]

    def annotation(self, each: Field[Any], kind: Any) -> Any:
        """Return the type of a field with its `typer.Option`."""
        if "option" not in each.metadata:
            return kind
        more = {"rich_help_panel": getattr(self.record, "panel", None), **each.metadata["option"]}
        name = each.name.replace("_", "-")
        own = f"--{name}/--no-{name}" if each.default is True else f"--{name}"
        flags = more.pop("flags") or [own]
        return Annotated[kind, typer.Option(*flags, **more)]

    def gather(self, values: dict[str, Any]) -> Any:
        return self.record(**values)


def keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default
    )


def shows(*flags: str) -> Callable[[Body], Body]:
    """Name the options that the help of a verb lists; `--help-all` lists the others too."""

    def mark(body: Body) -> Body:
        setattr(body, SHOWN_OPTIONS, {*flags, *HELP_FLAGS})
        return body

    return mark


def as_command(body: Body) -> Body:
    """Make a function of single options from a function whose parameters may be groups of them.

    A parameter is a group if its annotation is a dataclass, or `Annotated[..., OptionGroup]`.
    """
    options: list[inspect.Parameter] = []
    groups: dict[str, tuple[OptionGroup, list[str]]] = {}
    # not get_type_hints: before Python 3.11 it wraps what defaults to None, hiding the option
    for name, parameter in inspect.signature(body, eval_str=True).parameters.items():
        if group := _group(parameter.annotation):
            members = group.parameters()
            groups[name] = group, [member.name for member in members]
            options += members
        else:
            options.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    options += [keyword("set_", SetOption, None), keyword("help_all", HelpAll, False)]

    def command(**values: Any) -> Any:
        del values["set_"], values["help_all"]  # VerbCommand has treated them
        values = with_saved_regions(values)
        gathered = {
            name: group.gather({member: values.pop(member) for member in members})
            for name, (group, members) in groups.items()
        }
        return body(**values, **gathered)

    check_flags(options)
    command.__name__, command.__doc__ = body.__name__, paragraphs(body)
    command.__signature__ = inspect.Signature(options)  # pyright: ignore[reportFunctionMemberAccess]
    command.__annotations__ = {option.name: option.annotation for option in options}
    return command


def own_flags(body: Body) -> set[str]:
    """The flags of a verb's own options and dataclasses: all but those derived from settings."""
    flags = {"--help"}
    for parameter in inspect.signature(body, eval_str=True).parameters.values():
        group = _group(parameter.annotation)
        if group is None or isinstance(group, DataclassGroup):
            members = [parameter] if group is None else group.parameters()
            flags.update(flag for member in members for flag in flags_of(member))
    return flags


def check_flags(options: Iterable[inspect.Parameter]) -> None:
    """Raise TypeError, naming both, for two options with the same flag."""
    owners: dict[str, str] = {}
    for option in options:
        for flag in flags_of(option):
            if flag in owners:
                raise TypeError(f"{owners[flag]} and {option.name} have the same flag, {flag}")
            owners[flag] = option.name


def flags_of(parameter: inspect.Parameter) -> list[str]:
    """The flags of an option, with the one that negates it; none of an argument."""
    return [
        flag
        for item in get_args(parameter.annotation)
        if isinstance(item, OptionInfo)
        # in an Annotated, typer.Option holds its first name as the default
        for declared in (item.default, *(item.param_decls or ()))
        if isinstance(declared, str)
        for flag in declared.split("/")
    ]


def paragraphs(body: Body) -> str:
    """The docstring with each paragraph on one line: a terminal folds it to its own width."""
    return "\n\n".join(" ".join(each.split()) for each in (body.__doc__ or "").split("\n\n"))


def _group(annotation: Any) -> OptionGroup | None:
    if is_dataclass(annotation) and isinstance(annotation, type):
        return DataclassGroup(annotation)
    if get_origin(annotation) is Annotated:
        return next((item for item in get_args(annotation) if isinstance(item, OptionGroup)), None)
    return None


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
        """Write the arguments and options that are not hidden, by panel if there are several."""
        sections: dict[str, list[tuple[str, str]]] = defaultdict(list)
        for param in self.get_params(ctx):
            if record := param.get_help_record(ctx):
                is_option = param.opts[0].startswith("-")
                kind = "Options" if is_option else "Arguments"
                panel = getattr(param, "rich_help_panel", None) if ctx.obj is HELP_ALL else None
                name = VALUE_TYPE.sub(lambda match: METAVARS[match[1]], record[0])
                name = name if is_option else name.partition(" ")[0]  # it says what it is
                text = DEFAULT_IN_BRACKETS.sub(r"[default: \1", record[1])
                sections[panel or kind].append((name, text))
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records, col_max=COLUMN_WIDTH)


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
            known.setdefault(param.opts[0].removeprefix("--").replace("-", "_"), param)
    wanted = name.strip().removeprefix("--").replace("-", "_")
    if wanted in known:
        return known[wanted]
    ends = {path: param for path, param in known.items() if path.rpartition(".")[2] == wanted}
    if len({id(param) for param in ends.values()}) == 1:
        return next(iter(ends.values()))
    close = list(ends) or get_close_matches(wanted, known, 1)
    move = f"did you mean {' or '.join(close)}?" if close else "--help-all lists the names"
    raise typer.BadParameter(f"--set {name}: no option has this name; {move}")


class LazyCommand(TyperCommand):
    """A verb that is listed at once, and whose options are made when it is asked for.

    Options that are derived from settings import the records of those settings.
    """

    def __init__(self, name: str, summary: str, make: Callable[[], Any]) -> None:
        super().__init__(name, help=summary)
        self.make = make
        """Returns the whole command."""

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Return the context of the whole command, which then replaces this one."""
        return self.make().make_context(*args, **options)


def verb_name(body: Body) -> str:
    """Return the name of a verb as it is typed: `filter` for the function `filter_`."""
    return body.__name__.strip("_").replace("_", "-")


def lazy_verb(body: Body) -> LazyCommand:
    """Make the verb of a function, with its name and the first line of its docstring."""
    summary = paragraphs(body).split("\n")[0]
    return LazyCommand(verb_name(body), summary, lambda: verb_command(body, body))


def verb_command(body: Body, function: Body) -> Any:
    """Make the whole command of `function`; `body` says which options its help lists."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(verb_name(body), cls=VerbCommand)(as_command(function))
    command = typer.main.get_command(app)
    shown = getattr(body, SHOWN_OPTIONS, None)
    for param in command.params:
        flags = {each for each in param.opts if each.startswith("-")}
        if flags:
            hidden = flags.isdisjoint(shown) if shown else not flags.isdisjoint(RARE)
            setattr(param, "hidden", hidden)  # noqa: B010  # an option has it, a parameter not
    return command


def show_all(ctx: Any, requested: bool) -> None:
    """Print the help with all options, and end the command."""
    if requested:
        reveal(ctx)
        typer.echo(ctx.get_help())
        raise typer.Exit


def reveal(ctx: Any) -> None:
    """Let the help of the context's command list all options, by panel."""
    for param in ctx.command.params:
        param.hidden = False
    ctx.obj = HELP_ALL


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
    bool,
    typer.Option("--help-all", is_eager=True, callback=show_all, help="List all options."),
]
