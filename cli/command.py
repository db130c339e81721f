"""A verb's function as a command: its groups of options are spread into single options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Protocol, get_args, get_origin, get_type_hints, runtime_checkable

import typer
from typer.core import TyperCommand
from typer.models import OptionInfo

Body = Callable[..., Any]


@runtime_checkable
class OptionGroup(Protocol):
    """Options that a verb receives as one value: metadata of its parameter's `Annotated`."""

    def parameters(self) -> list[inspect.Parameter]:
        """The single options, each a keyword-only parameter as typer reads them."""
        ...

    def gather(self, values: dict[str, Any]) -> Any:
        """The verb's value, from the values of the options by parameter name."""
        ...


class DataclassGroup:
    """The fields of a dataclass, whose annotations hold their `typer.Option`."""

    def __init__(self, record: type) -> None:
        self.record = record

    def parameters(self) -> list[inspect.Parameter]:
        types = get_type_hints(self.record, include_extras=True)
        return [
            keyword(field.name, types[field.name], field.default) for field in fields(self.record)
        ]

    def gather(self, values: dict[str, Any]) -> Any:
        return self.record(**values)


def keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default
    )


def as_command(body: Body) -> Body:
    """A function whose parameters are single options: those of `body`, its groups spread.

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

    def command(**values: Any) -> Any:
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


class LazyCommand(TyperCommand):
    """A verb that is listed at once, and whose options are made when it is asked for.

    Options that are derived from settings import the records of those settings; the strategies of
    `gsedit edit` import torch too.
    """

    def __init__(self, name: str, summary: str, make: Callable[[], typer.Typer]) -> None:
        super().__init__(name, help=summary)
        self.make = make

    def make_context(self, *args: Any, **options: Any) -> Any:
        """The context of the whole command, which then replaces this one."""
        return typer.main.get_command(self.make()).make_context(*args, **options)


def lazy_verb(body: Body) -> LazyCommand:
    """The verb that `body` is, by its name and the first line of its docstring."""

    def make() -> typer.Typer:
        app = typer.Typer(add_completion=False)
        app.command(body.__name__)(as_command(body))
        return app

    return LazyCommand(body.__name__, paragraphs(body).split("\n")[0], make)
