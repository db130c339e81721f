"""Options of a verb, derived from the fields of a settings record: one field, one option.

The record gives type, choices and default; the docstring under a field gives the help; a flag that
differs from the field's name is in the field's metadata, as `{"flag": "--views"}`. A field that
holds another record gives that record's options, in a panel of their own. An option that is not
given leaves the value of the record that the options are applied to: a default, or a preset's.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import typer

from .command import keyword

Record = TypeVar("Record")
FieldPath = tuple[str, ...]
"""Where a field is, from the outermost record: ("sampler", "steps")."""
Values = Mapping[FieldPath, Any]

SIMPLE = (int, float, str, bool, Path)


@dataclass(frozen=True)
class Layout:
    """What the command line changes of a record's own names."""

    panel: str
    """Heading of the outermost record's options in the help."""
    panels: Mapping[str, str] = field(default_factory=dict)
    """Headings of nested records, by field; without one, the field's name."""
    defaults: Mapping[str, str] = field(default_factory=dict)
    """What the help shows as default where the record has None, by field."""
    without: tuple[str, ...] = ()
    """Fields of the outermost record that get no option."""


@dataclass(frozen=True)
class Setting:
    """A field of a settings record as an option."""

    path: FieldPath
    flag: str
    type: Any
    """One of SIMPLE, or an Enum of the choices."""
    help: str
    panel: str

    @property
    def name(self) -> str:
        """The parameter's name in the verb's function."""
        return "__".join(self.path)

    def parameter(self) -> inspect.Parameter:
        """The option as typer reads it; None where it is not given."""
        option = typer.Option(
            self.flag, help=self.help, rich_help_panel=self.panel, show_default=False
        )
        return keyword(self.name, Annotated[self.type | None, option], None)


class SettingsGroup:
    """The options of a settings record as one parameter of a verb: `Values` of those given."""

    def __init__(self, settings: Callable[[], Iterable[Setting]]) -> None:
        self.settings = settings
        """Called when the verb is asked for: it imports the record, and with it the library."""

    def parameters(self) -> list[inspect.Parameter]:
        return [setting.parameter() for setting in self.settings()]

    def gather(self, values: dict[str, Any]) -> Values:
        return {
            tuple(name.split("__")): value.value if isinstance(value, Enum) else value
            for name, value in values.items()
            if value is not None
        }


def settings_of(defaults: Any, layout: Layout) -> list[Setting]:
    """The options of a settings record, which `defaults` is an instance of.

    A flag that is taken by an earlier field gets the name of its record's field as a prefix:
    `--steps` of `sampler`, then `--update-steps` of `update`. Raises TypeError for a field whose
    type no option can hold.
    """
    return _settings_of(defaults, layout, (), layout.panel, set())


def _settings_of(
    defaults: Any, layout: Layout, parents: FieldPath, panel: str, taken: set[str]
) -> list[Setting]:
    settings: list[Setting] = []
    types, docs = get_type_hints(type(defaults)), field_docs(type(defaults))
    for item in fields(defaults):
        name = item.name
        path, default = (*parents, name), getattr(defaults, name)
        if not parents and name in layout.without:
            continue
        if is_dataclass(default):
            heading = layout.panels.get(name, name.replace("_", " ").capitalize())
            settings += _settings_of(default, layout, path, heading, taken)
            continue
        flag = item.metadata.get("flag", f"--{name.replace('_', '-')}")
        if flag in taken and parents:
            flag = f"--{parents[-1]}-{flag.removeprefix('--')}"
        taken.add(flag)
        if default is True:
            flag = f"{flag}/--no-{flag.removeprefix('--')}"
        help = help_text(docs.get(name, name), default, layout.defaults.get(name))
        settings.append(Setting(path, flag, option_type(path, types[name]), help, panel))
    return settings


def option_type(path: FieldPath, annotation: Any) -> Any:
    """The type of a field's option: the field's own, or an Enum of the choices of a Literal.

    Raises TypeError for a type that no option can hold.
    """
    alternatives = [item for item in get_args(annotation) if item is not type(None)]
    if get_origin(annotation) is Literal:
        return Enum(path[-1], {choice: choice for choice in alternatives}, type=str)
    if annotation in SIMPLE:
        return annotation
    if len(alternatives) == 1 and type(None) in get_args(annotation):
        return option_type(path, alternatives[0])
    raise TypeError(f"setting {'.'.join(path)}: no option can hold a {annotation}")


def help_text(doc: str, default: Any, none_means: str | None = None) -> str:
    """The help of an option: its field's docstring, and the default in parentheses.

    A docstring may end with "None: ..." to say what an absent value means: this is then shown as
    the default, unless `none_means` says more.
    """
    from rich.markup import escape

    text, *rest = re.split(r"(?:^|\s)None: ", " ".join(doc.replace("`", "").split()))
    text = text.rstrip(" .;")
    match default:
        case None:
            shown = f": {none_means or rest[0].rstrip('.')}" if none_means or rest else ""
        case bool():
            shown = " yes" if default else ""
        case float():
            shown = f" {default:g}"
        case _:
            shown = f" {default}"
    return escape(f"{text} (default{shown})." if shown else f"{text}.")


def field_docs(record: type) -> dict[str, str]:
    """The docstring under each field of a dataclass and its bases; none without source code."""
    docs: dict[str, str] = {}
    for base in reversed(record.__mro__[:-1]):
        try:
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except (OSError, TypeError):
            continue
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for statement, after in pairwise(body):
            match statement, after:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(doc))),
                ):
                    docs[name] = doc
    return docs


def with_values(record: Record, values: Values) -> Record:
    """The record with the given values in place of its own. Raises what its checks raise."""
    own = {path[0]: value for path, value in values.items() if len(path) == 1}
    nested: dict[str, dict[FieldPath, Any]] = {}
    for (head, *tail), value in values.items():
        if tail:
            nested.setdefault(head, {})[tuple(tail)] = value
    inner = {name: with_values(getattr(record, name), each) for name, each in nested.items()}
    return replace(record, **own, **inner)  # pyright: ignore[reportArgumentType, reportCallIssue]
