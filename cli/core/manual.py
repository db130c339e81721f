"""Manual pages, from the help of the program itself; setup.py makes them for a wheel."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import typer

from .command import VerbCommand, reveal

PROGRAM = "gsedit"
SPECIAL = {"\\": r"\e", "-": r"\-", "'": r"\(aq", "`": r"\(ga", "^": r"\(ha", "~": r"\(ti"}
"""Characters that troff would change or obey; a hyphen that is not escaped cannot be pasted."""


def manual_pages(version: str) -> dict[str, str]:
    """Make the page of the program and of each verb, by file name, as in gsedit-edit.1."""
    from ..main import app

    program = typer.main.get_command(app)
    root = typer.Context(program, info_name=PROGRAM, **program.context_settings)
    pages = list(_contexts(root))
    names = [_name(each) for each in pages]
    return {f"{name}.1": _page(each, version, names) for name, each in zip(names, pages)}


def _contexts(context: Any) -> Iterator[Any]:
    """Yield the context of a command and of all below it, parents first."""
    group = context.command
    if isinstance(group, VerbCommand):
        reveal(context)
    yield context
    for name, command in getattr(group, "commands", {}).items():
        command = getattr(command, "make", lambda made=command: made)()  # a lazy one's own
        yield from _contexts(typer.Context(command, info_name=name, parent=context))


def _name(context: Any) -> str:
    return context.command_path.replace(" ", "-")


def _page(context: Any, version: str, names: Iterable[str]) -> str:
    """Write a page in the macros of man(7)."""
    name = _name(context)
    above = name.rpartition("-")[0]
    near = [each for each in names if above == each or each.rpartition("-")[0] == name]
    help_text = context.command.help or ""
    page = Page()
    page.lines += [
        ".nr HY 0",  # no word is parted
        f'.TH "{escaped(name.upper())}" 1 "" "{PROGRAM} {escaped(version)}"',
        ".ad l",
        ".SH NAME",
        f"{escaped(name)} \\- {escaped(help_text.splitlines()[0].rstrip('.'))}",
    ]
    context.command.format_help(context, page)
    if near:
        page.lines += [".SH SEE ALSO", ", ".join(rf"\fB{escaped(each)}\fP(1)" for each in near)]
    return "\n".join(page.lines) + "\n"


def is_example(paragraph: str) -> bool:
    """Whether a paragraph of a help is a command line, and no sentence."""
    return paragraph.startswith(f"{PROGRAM} ") and ". " not in paragraph


def escaped(text: str) -> str:
    """Text as troff prints it unchanged."""
    ascii_text = re.sub(r"[^\x00-\x7f]", lambda found: f"\0u{ord(found[0]):04X}]", text)
    safe = "".join(SPECIAL.get(each, each) for each in ascii_text).replace("\0", "\\[")
    return re.sub(r"^(?=\.)", r"\\&", safe)


class Page:
    """A page in the making: a command writes its help to it, as to typer's formatter."""

    width = 10_000
    """Characters of a line: summaries are not cut short."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        self.lines += [".SH SYNOPSIS", rf"\fB{escaped(prog)}\fP {escaped(args)}"]

    def write_text(self, text: str) -> None:
        self.lines.append(".SH DESCRIPTION")
        for paragraph in text.split("\n\n"):
            line = escaped(" ".join(paragraph.split()))
            self.lines += [".PP", *([".EX", line, ".EE"] if is_example(paragraph) else [line])]

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 0) -> None:
        for term, meaning in rows:
            self.lines += [".TP", rf"\fB{escaped(term)}\fP", escaped(" ".join(meaning.split()))]

    def section(self, name: str) -> AbstractContextManager[None]:
        self.lines.append(f'.SH "{escaped(name.upper())}"')
        return nullcontext()

    def indentation(self) -> AbstractContextManager[None]:
        return nullcontext()

    def write_paragraph(self) -> None:
        pass
