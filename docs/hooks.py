"""MkDocs hook: pages of the reference that are generated from the code at build time."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]

DOORS = {
    "gsedit": "Load, edit, fit, render and save scenes.",
    "gsedit.toolkit": "Operations on scenes as tables. They need no torch.",
    "rasterizer": "A picture of Gaussians and its gradient. Usable without gsedit.",
}
"""Modules whose exported names are the Python API; a name that is not there is left out."""

SETTINGS = re.compile(r"(Edit|Fit|Sampler|Update|Capture)Settings|Numerics|Execution")
"""Names of the records of settings that have a table, wherever in the code they are defined."""

COPIES = {
    "reference/changelog.md": "CHANGELOG.md",
    "reference/contributing.md": "CONTRIBUTING.md",
    "reference/security.md": "SECURITY.md",
}
"""Pages that are files elsewhere in the tree."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages to those in docs/."""
    pages = {
        "reference/command-line.md": command_line(),
        "reference/settings.md": settings(),
        "reference/python.md": python(),
        **{page: copied(source) for page, source in COPIES.items()},
    }
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def copied(source: str) -> str:
    """Return the text of a file with its links as from the folder of the reference pages."""
    text = re.sub(r"\]\(docs/", "](../", (ROOT / source).read_text())
    for page, other in COPIES.items():
        text = text.replace(f"]({other})", f"]({Path(page).name})")
    return text


def command_line() -> str:
    """Return the page of all commands, from the command-line program itself."""
    from gsedit_cli.main import app

    group = typer.main.get_command(app)
    lines = [
        "# Command line",
        "",
        "Generated from the code. `gsedit VERB --help` shows the options that most users need, and "
        "`--help-all` all that have a flag, as here. Every verb has `--help`, `--help-all`, and "
        "`--set NAME=VALUE`, which gives any option or [setting](settings.md) a value.",
    ]
    for name, command in _walk(group, "gsedit"):
        usage = " ".join(command.collect_usage_pieces(typer.Context(command, info_name=name)))
        lines += ["", f"## {name}", "", f"`{name} {usage}`", "", _help(command.help)]
        if rows := list(_option_rows(command)):
            lines += ["", "| option | default | meaning |", "|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def _walk(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield every command below a group with its full name, parents first."""
    context = typer.Context(command, info_name=path)
    for name in getattr(command, "list_commands", lambda _: [])(context):
        found = command.get_command(context, name)
        if found is not None and not found.hidden:
            found = found.make_context(name, [], resilient_parsing=True).command  # a lazy one's own
            yield f"{path} {name}", found
            yield from _walk(found, f"{path} {name}")


def _option_rows(command: Any) -> Iterator[str]:
    """Yield a row of a table for each argument and option."""
    context = typer.Context(command)
    for option in command.get_params(context):
        is_set = option.opts[0].startswith("--set.")
        if is_set or {"--help", "--help-all", "--set"} & {*option.opts}:
            continue
        names = ", ".join((*option.opts, *option.secondary_opts))
        is_flag = getattr(option, "is_flag", False)
        value = "" if is_flag else _value(option)
        if option.param_type_name == "argument":
            names, value = "", value if option.metavar else names.upper()
        has_default = isinstance(option.default, str | int | float) and not is_flag
        default = getattr(option.default, "value", option.default) if has_default else ""
        meaning = _linked(_prose(getattr(option, "help", None)))
        yield f"| {_code(f'{names} {value}')} | {_cell(str(default))} | {meaning} |"


def _value(option: Any) -> str:
    """Return what stands for the value of an option: its metavar, or the name of its type."""
    if option.metavar:
        return option.metavar
    described = getattr(option, "type_descriptor", None)  # typer; with click a parameter has a type
    kind = described.annotation if described else option.type
    choices = get_args(kind) or tuple(getattr(kind, "choices", ()))
    if isinstance(kind, type) and issubclass(kind, Enum):
        choices = tuple(each.value for each in kind)
    return "|".join(map(str, choices)) or getattr(kind, "__name__", "value").upper()


def _help(text: str | None) -> str:
    """Return the help of a verb, its command lines as code."""
    paragraphs = re.split(r"\n\s*\n", _prose(text))
    return "\n\n".join(
        f"    {each.replace('&lt;', '<')}" if _is_example(each) else _linked(each)
        for each in paragraphs
    )  # fmt: skip


def _is_example(paragraph: str) -> bool:
    """Whether a paragraph of a help is a command line, and no sentence."""
    return paragraph.startswith("gsedit ") and ". " not in paragraph


def _linked(text: str) -> str:
    """Return text for a cell of a table, with links in place of the paths of pages."""
    return re.sub(r"docs/([\w/]+)\.md", r"[\1](../\1.md)", _cell(text))


def _prose(text: str | None) -> str:
    """Return help without click's marks, safe in Markdown and HTML."""
    return (text or "").replace("\b", "").replace("\f", "").replace("<", "&lt;").strip()


def _cell(text: str) -> str:
    """Return text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")


def _code(text: str) -> str:
    """Return code for a cell of a table."""
    return f"`{text.strip()}`".replace("|", "\\|") if text.strip() else ""


def settings() -> str:
    """Return the page of all records of settings: field, type, default, meaning."""
    lines = [
        "# Settings",
        "",
        "Generated from the code. The records are frozen; a bad value raises `UsageError`.",
    ]
    for record in _records():
        about = _prose(inspect.cleandoc(record.__doc__ or ""))
        lines += ["", f"## {record.__name__}", "", about, ""]
        lines += ["| field | type | default | meaning |", "|---|---|---|---|"]
        documented = _field_docs(record)
        for field in fields(record):
            cells = (_code(field.name), _code(str(field.type)), _code(_default(field)))
            meaning = _cell(_prose(documented.get(field.name)))
            lines.append(f"| {' | '.join(cells)} | {meaning} |")
    return "\n".join(lines) + "\n"


def _records() -> list[type]:
    """Return the settings records of every public module, and every strategy, by name."""
    found: dict[str, type] = {}
    for package in ("gsedit", "rasterizer"):
        root = importlib.import_module(package)
        for module in pkgutil.walk_packages(root.__path__, f"{package}."):
            if _may_have_settings(module.name):
                for name, value in vars(importlib.import_module(module.name)).items():
                    if _is_settings(name, value) and value.__module__ == module.name:
                        found[name] = value
    return [found[name] for name in sorted(found)]


def _may_have_settings(module: str) -> bool:
    """Return whether a module's source defines settings or a strategy, without importing it."""
    spec = find_spec(module)
    if spec is None or not (spec.origin or "").endswith(".py") or ".bench" in module:
        return False
    text = Path(str(spec.origin)).read_text()
    return bool(re.search(rf"^class ({SETTINGS.pattern})\b|def schedule\(", text, re.MULTILINE))


def _is_settings(name: str, value: object) -> bool:
    """Return whether a module's name is a public record of settings or of a strategy."""
    if not (isinstance(value, type) and is_dataclass(value)) or name.startswith("_"):
        return False
    return bool(SETTINGS.fullmatch(name)) or (
        ".strategies." in value.__module__
        and "._" not in value.__module__
        and hasattr(value, "schedule")
    )


def _default(field: Field[Any]) -> str:
    if field.default_factory is not MISSING:
        return f"{getattr(field.default_factory, '__name__', 'value')}()"
    return "" if field.default is MISSING else repr(field.default)


def _field_docs(record: type) -> dict[str, str]:
    """Return the docstring under each field of a record and its bases, from the source."""
    documented: dict[str, str] = {}
    for base in reversed(record.__mro__[:-1]):
        if is_dataclass(base):
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
            for statement, after in pairwise(getattr(definition, "body", [])):
                match statement, after:
                    case (
                        ast.AnnAssign(target=ast.Name(id=name)),
                        ast.Expr(value=ast.Constant(value=str(text))),
                    ):
                        documented[name] = text
    return documented


def python() -> str:
    """Return the page of the Python API: every exported name of the public modules."""
    lines = ["# Python", "", "Generated from the code: the names that these modules export."]
    for door, what in DOORS.items():
        if not (ROOT / door.replace(".", "/")).is_dir():
            continue
        lines += ["", f"## {door}", "", what, ""]
        module = importlib.import_module(door)
        for name in module.__all__:  # where it is defined: a module may have a function's name
            home = getattr(getattr(module, name), "__module__", door)
            lines += [f"::: {home}.{name}", ""]
    return "\n".join(lines) + "\n"
