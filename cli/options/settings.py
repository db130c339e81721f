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
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import typer

from gsedit.errors import UsageError

from ..core.command import keyword

Record = TypeVar("Record")
FieldPath = tuple[str, ...]
"""Names of fields from the outermost record inwards: ("sampler", "steps")."""
Values = Mapping[FieldPath, Any]

SIMPLE = (int, float, str, bool, Path)


@dataclass(frozen=True)
class Layout:
    """Headings of a record's options, and fields without an option."""

    panel: str
    """Heading of the outermost record's options in the help."""
    panels: Mapping[str, str] = field(default_factory=dict)
    """Headings of nested records, by field; without one, the field's name."""
    without: tuple[str, ...] = ()
    """Fields that get no option."""


@dataclass(frozen=True)
class Setting:
    """A field of a settings record as an option."""

    path: FieldPath
    flag: str
    type: Any
    """One of SIMPLE, or a Literal of the choices."""
    meaning: str
    default: str
    """Text of the default value; empty where there is none to show."""
    panel: str
    negatable: bool = False
    """Whether --no-... exists beside the flag."""

    @property
    def name(self) -> str:
        """The parameter's name in the verb's function."""
        return "__".join(self.path)

    def parameter(self) -> inspect.Parameter:
        """The option as typer reads it; None where it is not given."""
        flag = f"{self.flag}/--no-{self.flag.removeprefix('--')}" if self.negatable else self.flag
        default = f"  [default: {self.default}]" if self.default else ""
        option = typer.Option(
            flag,
            help=f"{self.meaning}{default}",
            metavar=choices_text(self.type),
            rich_help_panel=self.panel,
            show_default=False,
        )
        return keyword(self.name, Annotated[self.type | None, option], None)


class SettingsGroup:
    """The options of a settings record as one parameter of a verb: `Values` of those given."""

    def __init__(self, settings: Callable[[], Iterable[Setting]]) -> None:
        self.settings = settings
        """Called when the verb is asked for: it imports the record."""

    def parameters(self) -> list[inspect.Parameter]:
        return [setting.parameter() for setting in self.settings()]

    def gather(self, values: dict[str, Any]) -> Values:
        return {
            tuple(name.split("__")): value for name, value in values.items() if value is not None
        }


def settings_of(
    defaults: Any, layout: Layout, parents: FieldPath = (), taken: Iterable[str] = ()
) -> list[Setting]:
    """The options of a settings record, which `defaults` is an instance of.

    A flag that is `taken`, or by an earlier field, gets the name of its record's field (the last of
    `parents`) as a prefix: `--steps` of `sampler`, then `--update-steps` of `update`. Raises
    TypeError for a field whose type no option can hold.
    """
    settings: list[Setting] = []
    types, docs = get_type_hints(type(defaults)), field_docs(type(defaults))
    for item in fields(defaults):
        if item.name in layout.without:
            continue
        path, default = (*parents, item.name), getattr(defaults, item.name)
        in_use = {*taken, *(setting.flag for setting in settings)}
        if is_dataclass(default):
            heading = layout.panels.get(item.name, item.name.replace("_", " ").capitalize())
            settings += settings_of(default, Layout(heading, layout.panels), path, in_use)
        else:
            settings.append(
                Setting(
                    path,
                    flag_of(item, parents, in_use),
                    option_type(path, types[item.name]),
                    *meaning_and_default(docs.get(item.name, item.name), default),
                    layout.panel,
                    negatable=default is True,
                )
            )
    return settings


def flag_of(item: Field[Any], parents: FieldPath, taken: Iterable[str]) -> str:
    """The flag of a field: from its metadata, or its name; with a prefix where it is taken."""
    flag = item.metadata.get("flag", f"--{item.name.replace('_', '-')}")
    if flag in taken and parents:
        flag = f"--{parents[-1].replace('_', '-')}-{flag.removeprefix('--')}"
    return flag


def option_type(path: FieldPath, annotation: Any) -> Any:
    """The type of a field's option: the field's own, without None.

    Raises TypeError for a type that no option can hold.
    """
    if get_origin(annotation) is Literal or annotation in SIMPLE:
        return annotation
    alternatives = [item for item in get_args(annotation) if item is not type(None)]
    if len(alternatives) == 1 and type(None) in get_args(annotation):
        return option_type(path, alternatives[0])
    raise TypeError(f"setting {'.'.join(path)}: no option can hold a {annotation}")


def choices_text(kind: Any) -> str | None:
    """Return the choices of a Literal for the help; None for any other type, which typer names."""
    return "|".join(get_args(kind)) or None


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
            shown = f"{default:g}"
        case _:
            shown = str(default)
    return f"{text.rstrip(' .;')}.", shown


@lru_cache
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
    """The record with the given values in place of its own. Raises UsageError for a bad value."""
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
